"""The report: what became of each field that the EDF and its CDFs have, with its place. Pure.

Takes the files' texts, the table of classes and the remarks of the conversion; gives fields in the order of the files,
as text and as JSON.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from msgspec.structs import replace

from srprov.codes import Code
from srprov.errors import Diagnostic, visible
from srprov.exporting.classes import CDF, EDF, Table, has_finer, has_names, rule_of
from srprov.exporting.model import DROPPED, EXACT, KINDS, REFUSED, Export, Field, Path, Remark
from srprov.yamldoc import loader, nodes
from srprov.yamldoc.nodes import Map, Node

_EXTENSION = (DROPPED, "an extension of the file's own")
_COMPOSE = (EDF, CDF)
_NOTHING = ("", "false", "null", "~", "0")


def fields_of(
    files: Mapping[str, str], edf: str, remarks: Iterable[Remark], tables: tuple[Table, Table] = _COMPOSE
) -> tuple[Field, ...]:
    """Return what became of each field.

    Args:
        files: Path -> text of the EDF and of the CDFs that are YAML.
        edf: Path of the EDF.
        remarks: What was found out in the conversion; each is about the EDF.
        tables: What becomes of fields of an EDF, and of a CDF.
    """
    said: dict[Path, list[Remark]] = {}
    for one in dict.fromkeys(remarks):
        said.setdefault(one.path, []).append(one)
    found = []
    for path in sorted(files, key=lambda file: (file != edf, file)):
        root = loader.parse(files[path], path)
        if isinstance(root, Map):
            of_file = list(_below(root, (), tables[path != edf], said if path == edf else {}))
            of_file += _unwritten(root, said) if path == edf else ()
            found += sorted(of_file, key=lambda one: (one.location, one.name))
    return tuple(found)


def _below(node: Map, path: Path, table: Table, said: Mapping[Path, list[Remark]]) -> Iterator[Field]:
    for key, value in node.entries.items():
        here, place = (*path, key), node.keys.get(key, value)
        if key.startswith("x-") and not has_names(table, path):
            yield _field(here, place, *_EXTENSION)
        elif isinstance(value, Map) and has_finer(table, here):
            yield from _below(value, here, table, said)
        elif rule := rule_of(table, here):
            line = (EXACT, "") if rule[1][0] == REFUSED and _says_nothing(value) else rule[1]
            yield _field(here, place, *_judged(said.get(here, []), *line))


def _says_nothing(node: Node) -> bool:
    """Return whether a value asks for nothing, such as `privileged: false`: what has no counterpart is not missed."""
    if isinstance(node, nodes.Scalar):
        return node.text in _NOTHING
    return not (node.entries if isinstance(node, Map) else node.items)


def lossy(fields: Iterable[Field]) -> tuple[Field, ...]:
    """Return fields for a user who takes the loss: what would be refused is dropped."""
    return tuple(replace(one, kind=DROPPED) if one.kind == REFUSED else one for one in fields)


def _unwritten(root: Map, said: Mapping[Path, list[Remark]]) -> Iterator[Field]:
    """Yield what is to be said of fields that the EDF does not write: they have a default, or a CDF says them."""
    for path, some in said.items():
        if _is_there(root, path) or not any(one.words for one in some):
            continue
        kind, words = _judged(some, EXACT, "")
        above = root.entries.get(path[0])
        named = above.keys.get(path[1]) if isinstance(above, Map) and len(path) > 1 else None
        yield _field(path, named or nodes.key_or_value(root, path[0]), kind, words)


def _is_there(root: Map, path: Path) -> bool:
    node: Node | None = root
    for part in path:
        node = node.entries.get(part) if isinstance(node, Map) else None
    return node is not None


def _judged(said: Sequence[Remark], kind: str, words: str) -> tuple[str, str]:
    """Return the class and the words of a field: what was found out, else what the table says."""
    if not said:
        return kind, words
    worst = max((one.kind for one in said), key=KINDS.index)
    return worst, "; ".join(dict.fromkeys(one.words for one in said if one.words))


def _field(path: Path, place: Node, kind: str, words: str) -> Field:
    return Field(kind=kind, name=nodes.dotted(path), location=nodes.location(place), words=words)


def refused(fields: Iterable[Field]) -> tuple[Diagnostic, ...]:
    """Return the problems because of which nothing is written."""
    return tuple(
        Diagnostic(one.location, f"cannot be exported: {one.words}", one.name, code=Code.NOT_TRANSLATED)
        for one in fields
        if one.kind == REFUSED
    )


def counts(fields: Iterable[Field]) -> dict[str, int]:
    """Return how many fields there are of each class."""
    found = Counter(one.kind for one in fields)
    return {kind: found[kind] for kind in KINDS}


def report_lines(export: Export) -> list[str]:
    """Return the report as text: what is exact is counted, all else has a line."""
    lines = [
        visible(f"{one.location}: {one.kind}: {one.name}: {one.words}") for one in export.fields if one.kind != EXACT
    ]
    told = ", ".join(f"{count} {kind}" for kind, count in counts(export.fields).items() if count)
    return [*lines, f"{len(export.fields)} fields: {told}"]


def report_json(export: Export) -> dict[str, Any]:
    """Return the report as `schemas/export.schema.json` has it; files by their paths in the export."""
    return {
        "experiment": export.experiment,
        "edf": export.edf,
        "machines": [
            {"robot": one.robot, "file": f"{one.folder}{one.file}", "services": list(one.services)}
            for one in export.machines
        ],
        "counts": counts(export.fields),
        "fields": [
            {
                "class": one.kind,
                "field": one.name,
                "file": one.location.file,
                "line": one.location.line,
                "column": one.location.column,
                "note": one.words,
            }
            for one in export.fields
        ],
        "needs": [
            {"kind": one.kind, "name": one.name, "what": one.what, "command": one.command} for one in export.needs
        ],
        "notes": list(export.notes),
        "files": sorted(one.path for one in export.files if not one.is_folder),
    }
