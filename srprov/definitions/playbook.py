"""A user's playbook -> Playbook: read, and checked as far as that is possible without a robot.

Takes the EDF's `playbooks`, or a folder; gives `Playbook`s, and problems with file, line and column. Touches files, for
reading. Jinja2 says what is wrong with the template; then its skeletons are read as YAML and held to
`schemas/playbook.schema.json`, where a substitution may stand for anything; so is what it renders to (`check_item`).
"""

from __future__ import annotations

import glob
import os
import shlex
from collections.abc import Collection, Iterator

from msgspec.structs import replace

from srprov.believed import is_closed
from srprov.codes import Code
from srprov.data import schema as shipped_schema
from srprov.definitions import paths, schema, template
from srprov.definitions.playbookmodel import ADDED, AFTER, BEFORE, REPLACES, Playbook, PlaybookCommand
from srprov.definitions.template import HOLE
from srprov.definitions.template_check import check_template, scalar_at
from srprov.errors import DefinitionError, Diagnostic, Location, did_you_mean
from srprov.yamldoc import loader, nodes
from srprov.yamldoc.nodes import Findings, Map, Node, Path, Scalar, Seq, Source

MAX_LENGTH = 50_000
"""Ours have a few hundred characters; checking takes time with the square of it."""


def from_experiment(root: Map, folder: str, findings: Findings) -> tuple[Playbook, ...]:
    """Read the playbooks that an EDF names; what is wrong with them or with their paths is added to the findings."""
    given = root.entries.get("playbooks")
    found: dict[str, Playbook] = {}
    for place in (BEFORE, AFTER):
        listed = given.entries.get(place) if isinstance(given, Map) else None
        for index, item in enumerate(listed.items if isinstance(listed, Seq) else ()):
            path: Path = ("playbooks", place, index)
            if not isinstance(item, Scalar) or findings.broken(path):
                continue
            file = paths.resolve(item, folder, findings, path)
            if file and paths.is_left(item, file, path):
                continue
            if file and (file in found or not os.path.isfile(file)):
                what = "stands here twice" if file in found else "is a folder, not a playbook"
                findings.add(item, f"'{item.text}' {what}", path, code=Code.NO_SUCH_FILE)
            elif file:
                shown = paths.shown_beside(item.source.file, item.text)
                try:
                    found[file] = read(file, shown, os.path.normpath(item.text), place)
                except DefinitionError as error:
                    findings.extend(error.problems)
    return tuple(found.values())


def from_folder(folder: str, ours: Collection[str]) -> tuple[Playbook, ...]:
    """Read the user's own playbooks; one that is named like one of `ours` takes its place.

    Raises:
        DefinitionError: With everything that is wrong with any of them.
    """
    found: list[Playbook] = []
    problems: list[Diagnostic] = []
    for file in sorted(glob.glob(os.path.join(glob.escape(folder), "*.yml"))):
        name = os.path.basename(file)
        try:
            _check_whose(folder, file)
            found.append(read(file, file, name, REPLACES if name in ours else ADDED))
        except DefinitionError as error:
            problems.extend(error.problems)
    if problems:
        raise DefinitionError(problems)
    return tuple(found)


def _check_whose(*paths: str) -> None:
    """Refuse (DefinitionError) what others can write: about the user's own playbooks nobody is asked."""
    for path in paths:
        try:
            theirs = not is_closed(path)
        except OSError:
            continue  # who reads it says so
        if theirs:
            message = "others can write it, or a folder above it, and it states anything on robots as root"
            hint = f"look at it, then make it yours alone: chown, and chmod go-w {shlex.quote(str(path))}"
            raise DefinitionError([Diagnostic(Location(path), message, hint=hint, code=Code.STRANGE_FILE)])


def read(file: str, shown: str, name: str, place: str) -> Playbook:
    """Read one playbook; `shown` is what problems call it.

    Raises:
        DefinitionError: With everything that is wrong with it.
    """
    text = loader.read_text(file, shown, 20 * MAX_LENGTH).replace("\r\n", "\n").replace("\r", "\n")
    source = Source(shown, tuple(text.split("\n")))
    if len(text) > MAX_LENGTH:
        wrong = f"is longer than {MAX_LENGTH} characters"
        raise DefinitionError([Diagnostic(Location(shown), wrong, hint="cut it up", code=Code.TOO_LARGE)])
    findings = Findings()
    if not check_template(text, source, findings):
        raise DefinitionError(findings.problems)
    keys: set[tuple[int, int]] = set()
    commands: dict[int, PlaybookCommand] = {}
    holes = _holes(text)
    for skeleton in template.skeletons(text):
        for item in _items(skeleton, source, holes, findings):
            keys |= {(key.line, key.column) for key in item.keys.values() if key.text != "<<"}
            if next(iter(item.entries), "") == "command":
                commands[item.line] = PlaybookCommand(line=item.line, what=_command_text(item, holes))
    if findings.problems:
        raise DefinitionError(findings.problems)
    return Playbook(
        name=name, file=os.path.abspath(file), source=source, place=place, text=text,
        marked=template.marked(text, iter(keys)), commands=tuple(commands[line] for line in sorted(commands)),
    )  # fmt: skip


def _holes(text: str) -> dict[tuple[int, int], str]:
    """Return the substitutions as they are written, by line and column."""
    found = {}
    for part in template.pieces(text):
        if part.kind == "value":
            place = scalar_at(text, part.start, Source(""))
            found[(place.line, place.column)] = text[part.start : part.end]
    return found


def _items(skeleton: str, source: Source, holes: Collection[tuple[int, int]], findings: Findings) -> Iterator[Map]:
    """Return the items of a skeleton that are maps; everything that is wrong is added."""
    try:
        root = loader.parse(skeleton, source.file)
    except DefinitionError as error:
        findings.extend(replace(one, excerpt=source.excerpt(one.location.line)) for one in error.problems)
        return
    if root is None:
        return
    root = _with_source(root, source)
    if not isinstance(root, Seq):
        findings.add(root, f"a playbook is a list of resources, not {nodes.kind(root)}", code=Code.PLAYBOOK)
        return
    for index, item in enumerate(root.items):
        _check_holes(item, (index,), findings)
        found = Findings()
        check_item(item, found, (index,))
        findings.extend(one for one in found.problems if (one.location.line, one.location.column) not in holes)
        if isinstance(item, Map):
            yield item
        elif (item.line, item.column) in holes:
            wrong = "an item is a map whose first key names its module, and is not substituted"
            findings.add(item, wrong, (index,), code=Code.PLAYBOOK)


def _with_source(node: Node, source: Source) -> Node:
    """Return the node with the template's lines for its excerpts, not the skeleton's."""
    if isinstance(node, Map):
        entries = {key: _with_source(value, source) for key, value in node.entries.items()}
        keys = {key: replace(one, source=source) for key, one in node.keys.items()}
        return replace(node, source=source, entries=entries, keys=keys)
    if isinstance(node, Seq):
        return replace(node, source=source, items=tuple(_with_source(item, source) for item in node.items))
    return replace(node, source=source)


def _check_holes(node: Node, path: Path, findings: Findings) -> None:
    """Add every substitution that is only a part of a value, or of a key: its type would be lost."""
    hint = 'write the parts as one expression, e.g. {{ "ros-" ~ host }}'
    if isinstance(node, Scalar) and HOLE in node.text and (node.text != HOLE or not node.plain):
        findings.add(node, "a substitution must be a whole YAML value", path, hint, code=Code.TEMPLATE)
    for index, item in enumerate(node.items if isinstance(node, Seq) else ()):
        _check_holes(item, (*path, index), findings)
    if not isinstance(node, Map):
        return
    for key, value in node.entries.items():
        if HOLE in key:
            findings.add(node.keys.get(key, node), "a key cannot be substituted", path, code=Code.TEMPLATE)
        _check_holes(value, (*path, key.replace(HOLE, "")), findings)


def modules() -> tuple[str, ...]:
    """Return the modules that an item may begin with, in name order."""
    return tuple(sorted(shipped_schema("playbook")["$defs"]))


def check_item(item: Node, findings: Findings, path: Path = ()) -> None:
    """Add every way in which one item of a playbook is not a resource of its module."""
    if not isinstance(item, Map) or not item.entries:
        message = f"an item is a map whose first key names its module, not {nodes.kind(item)}"
        findings.add(item, message, path, code=Code.PLAYBOOK)
        return
    kind = next(iter(item.entries))
    if kind not in modules():
        later = next((key for key in item.entries if key in modules()), "")
        hint = f"put '{later}' first" if later else did_you_mean(kind, modules()) or f"known: {', '.join(modules())}"
        wrong, place = f"there is no module '{kind[:60]}'", item.keys.get(kind, item)
        findings.add(place, wrong, (*path, kind), hint, code=Code.PLAYBOOK)
        return
    schema.check_tags(item, findings, frozenset(), path)
    schema.check(item, f"playbook/{kind}", findings, path)


def _command_text(item: Map, holes: dict[tuple[int, int], str]) -> str:
    """Return what a `command` runs and how it is checked, as it is written."""

    def words(node: Node | None) -> str:
        if isinstance(node, Seq):
            return " ".join(words(one) for one in node.items)
        written = holes.get((node.line, node.column), node.text) if isinstance(node, Scalar) else ""
        return " ".join(written.split())

    get = item.entries.get
    told = f"runs: {words(get('argv')) or words(get('shell'))}"
    return told + (f"; its check, which plan runs too: {words(get('unless'))}" if "unless" in item.entries else "")
