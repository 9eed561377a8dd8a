"""What an import did with each key: as text, Markdown, JSON and SARIF. Takes a draft; returns text. Pure."""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any
from urllib.parse import quote

from srprov import __version__
from srprov.codes import Code
from srprov.conversion.experiment import Draft
from srprov.conversion.kept import Kept
from srprov.conversion.notes import Finding
from srprov.errors import Diagnostic, visible
from srprov.importing.normal import Note

_ORDER = (Kept.REFUSED, Kept.DROPPED, Kept.ADAPTED)
_HEADS = {
    Kept.REFUSED: "Refused: the experiment would be another one",
    Kept.DROPPED: "Dropped: nothing in an experiment does it",
    Kept.ADAPTED: "Adapted: kept by other means",
}
_NOTE = "noted"
_LEVELS = {Kept.REFUSED: "error", Kept.DROPPED: "warning", Kept.ADAPTED: "note"}


def counts(draft: Draft) -> dict[str, int]:
    """Return how many keys are in each class."""
    found = Counter(one.kept.value for one in draft.findings)
    return {kept.value: found[kept.value] for kept in Kept}


def summary(draft: Draft) -> str:
    """Return the counts in words."""
    return ", ".join(f"{number} {kept}" for kept, number in counts(draft).items())


def told(draft: Draft) -> list[Finding]:
    """Return the findings of keys that are not kept as they are, the worst first."""
    found = {kept: [one for one in draft.findings if one.kept is kept] for kept in _ORDER}
    return [one for kept in _ORDER for one in found[kept]]


def as_text(draft: Draft) -> str:
    """Return a line for each key that is not kept as it is, as compilers do, and the counts."""
    lines = []
    for one in told(draft):
        key = f"  [{one.key}]" if one.key else ""
        lines.append(f"{one.at}: {one.kept.value}: {one.message}{key}")
        if one.hint:
            lines.append(f"    hint: {one.hint}")
    lines += [
        f"{note.at}: note: {note.message}" + (f"\n    hint: {note.hint}" if note.hint else "") for note in draft.notes
    ]
    return "\n".join([*lines, *_unknown_values(draft), summary(draft)])


def _unknown_values(draft: Draft) -> list[str]:
    names = sorted({one.name for one in draft.variables if one.source == "unset"})
    return [f"variables without a value: {', '.join(names)}"] if names else []


def as_markdown(draft: Draft, files: Sequence[str]) -> str:
    """Return the report that lies with the experiment."""
    lines = ["# Import report", "", f"From {', '.join(_code(_short(one)) for one in files)} by srprov {__version__}."]
    lines += ["", f"Keys: {summary(draft)}.", ""]
    for kept in _ORDER:
        found = [one for one in draft.findings if one.kept is kept]
        if found:
            lines += [f"## {_HEADS[kept]}", "", "| place | key | what became of it |", "|---|---|---|"]
            lines += [f"| {_place(one)} | {_code(one.key)} | {_cell(_words(one))} |" for one in found]
            lines.append("")
    if draft.notes:
        lines += ["## Notes", ""]
        lines += [f"- {_cell(f'{_short(note.at.file)}:{note.at.line}: {_words(note)}')}" for note in draft.notes]
        lines.append("")
    return "\n".join([*lines, *_variables(draft)])


def _variables(draft: Draft) -> Iterator[str]:
    """Yield a table of the variables; their values stand in the experiment, and not here."""
    found = sorted({(one.name, one.source, one.at) for one in draft.variables})
    if found:
        yield from ("## Variables", "", "| name | where its value is from | place |", "|---|---|---|")
        for name, source, at in found:
            yield f"| {_code(name)} | {_cell(_short(source))} | {_cell(f'{_short(at.file)}:{at.line}:{at.column}')} |"
        yield ""


def _words(one: Finding | Note) -> str:
    return one.message + (f" ({one.hint})" if one.hint else "")


def _place(one: Finding) -> str:
    return _cell(f"{_short(one.at.file)}:{one.at.line}:{one.at.column}")


def _short(path: str) -> str:
    """Return a path without the folders of this machine: reports travel with experiments."""
    return os.path.basename(path) if os.path.isabs(path) else path


def _cell(text: str) -> str:
    return visible(text).replace("\\", "\\\\").replace("|", "\\|").replace("<", "&lt;")


def _code(text: str) -> str:
    return f"`{visible(text).replace('`', chr(39)).replace('|', '¦')}`" if text else ""


def as_document(draft: Draft, folder: str, services: Sequence[str]) -> dict[str, Any]:
    """Return what `--format json` prints; `folder` is empty where nothing was written."""
    return {
        "folder": folder,
        "name": draft.edf["name"],
        "services": list(services),
        "counts": counts(draft),
        "findings": [_row(one) for one in told(draft)],
        "notes": [{**_at(one), "message": one.message, "hint": one.hint} for one in draft.notes],
        "variables": [{**_at(one), "name": one.name, "source": one.source} for one in draft.variables],
    }


def _at(one: Any) -> dict[str, Any]:  # noqa: ANN401 - findings, notes and variables have `at` in common
    return {"file": one.at.file, "line": one.at.line, "column": one.at.column}


def of_problems(problems: Sequence[Diagnostic]) -> list[Finding]:
    """Return what a file is refused for as a whole, as findings."""
    return [Finding(one.location, one.path, Kept.REFUSED, one.message, one.hint, one.code) for one in problems]


def refusal(problems: Sequence[Diagnostic]) -> dict[str, Any]:
    """Return what `--format json` prints where nothing could be made of the files."""
    found = of_problems(problems)
    numbers = {kept.value: len(found) if kept is Kept.REFUSED else 0 for kept in Kept}
    return {
        "folder": "",
        "name": "",
        "services": [],
        "counts": numbers,
        "findings": [_row(one) for one in found],
        "notes": [],
        "variables": [],
    }


def _row(one: Finding) -> dict[str, Any]:
    code = one.code or (Code.NOT_TRANSLATED.value if one.kept is Kept.REFUSED else "")
    told = {"key": one.key, "kept": one.kept.value, "message": one.message, "hint": one.hint, "code": code}
    return {**_at(one), **told}


def as_sarif(found: Sequence[Finding], notes: Sequence[Note] = ()) -> str:
    """Return a SARIF 2.1.0 log with each key that is not kept as it is, and what else is to be known of the files."""
    heads = {**{kept.value: _HEADS[kept] for kept in _ORDER}, _NOTE: "Noted: to be known before it runs"}
    rules = [{"id": one, "shortDescription": {"text": head}} for one, head in heads.items()]
    run = {
        "tool": {"driver": {"name": "srprov import", "version": __version__, "rules": rules}},
        "columnKind": "unicodeCodePoints",
        "results": [*map(_result, found), *map(_noted, notes)],
    }
    log = {"$schema": "https://json.schemastore.org/sarif-2.1.0.json", "version": "2.1.0", "runs": [run]}
    return json.dumps(log, indent=2)


def _result(one: Finding) -> dict[str, Any]:
    place = _location(one)
    if one.key:
        place["logicalLocations"] = [{"fullyQualifiedName": one.key}]
    return {
        "ruleId": one.kept.value,
        "level": _LEVELS[one.kept],
        "message": {"text": _words(one)},
        "locations": [place],
    }


def _noted(one: Note) -> dict[str, Any]:
    return {"ruleId": _NOTE, "level": "note", "message": {"text": _words(one)}, "locations": [_location(one)]}


def _location(one: Finding | Note) -> dict[str, Any]:
    region = {"startLine": one.at.line, "startColumn": one.at.column}
    uri = quote(os.fsencode(one.at.file))
    return {"physicalLocation": {"artifactLocation": {"uri": uri}, "region": region}}
