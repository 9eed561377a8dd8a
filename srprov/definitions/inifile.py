"""An INI inventory, as Ansible reads it -> hosts, groups and variables.

Takes the text; adds to the `HostTree`. Pure. `[group]`, `[group:vars]`, `[group:children]`; host lines hold `name
key=value…` in shell quoting; a value that is a Python list, map or quoted text is read as one.
"""

from __future__ import annotations

import ast
import re
import warnings

from srprov.codes import Code
from srprov.definitions import words
from srprov.definitions.groups import HostTree, Variables
from srprov.definitions.unseen import blank
from srprov.errors import DefinitionError, Diagnostic, Location
from srprov.yamldoc import nodes
from srprov.yamldoc.nodes import Node, Scalar, Source

_SECTION = re.compile(r"\[(?P<name>[^:\]\s]+)(?::(?P<kind>\w+))?\]\s*(?:[#;].*)?")
_COMMENT = re.compile(r"(?:^|\s)[#;]")
"""What looks like the beginning of one, and is none in quotes."""
_LONGEST = 1_000_000
"""Characters of a file: splitting lines into words is slow."""
_LONGEST_LINE = 50_000
_LONGEST_LITERAL = 10_000


def read(text: str, file: str, tree: HostTree) -> None:
    """Add everything that the text says; what is wrong goes to the tree's findings."""
    if len(text) > _LONGEST:
        raise DefinitionError(
            [
                Diagnostic(
                    Location(file), f"is longer than {_LONGEST} characters", hint="write YAML", code=Code.TOO_LARGE
                )
            ]
        )
    source = Source(file, tuple(text.splitlines()))
    section, kind = "ungrouped", "hosts"
    for number, line in enumerate(source.lines, 1):
        bare = line.strip()
        column = len(line) - len(line.lstrip()) + 1
        place = Scalar(source, number, column, bare)
        if not bare or bare[0] in "#;":
            continue
        if len(bare) > _LONGEST_LINE:
            tree.findings.add(place, f"the line is longer than {_LONGEST_LINE} characters", code=Code.TOO_LARGE)
            continue
        match = _SECTION.fullmatch(bare)
        if match is None and bare.startswith("[") and "]" in bare and "=" not in bare:
            tree.findings.add(
                place, f"'{bare[:60]}' is not [group], [group:vars] or [group:children]", code=Code.INVENTORY
            )
        elif match is not None:
            section, kind = match["name"], match["kind"] or "hosts"
            if kind not in ("hosts", "vars", "children"):
                tree.findings.add(
                    place,
                    f"unknown section '{bare[:60]}'",
                    (),
                    "known: [group], [group:vars], [group:children]",
                    code=Code.INVENTORY,
                )
            tree.group(section)
        elif kind == "vars":
            _variable(place, section, tree)
        elif kind == "children":
            child = bare.split("#")[0].strip()
            tree.group(child)
            tree.group(section).children[child] = place
        else:
            _host(place, section, tree)


def _host(place: Scalar, group: str, tree: HostTree) -> None:
    try:
        name, *pairs = words.split(place.text, comments=True)
    except ValueError as error:
        tree.findings.add(place, f"cannot be split into words: {str(error).lower()}", code=Code.INVENTORY)
        return
    if any(_COMMENT.search(blank(one)) for one in pairs[:-1]) or any(one[:1] in ("#", ";") for one in pairs):
        message = "has a '#' or ';' that begins no comment: what stands behind it is read"
        tree.findings.add(place, message, (), "take it away, or put it at the end of the line", code=Code.INVENTORY)
        return
    variables: Variables = {}
    offset = 0
    for pair in pairs:
        key, sign, value = pair.partition("=")
        # where it stands is looked for behind the one before, and no more after one that is quoted: once over the line
        offset = place.text.find(f" {key}{sign}", offset) + 1 if offset >= 0 else offset
        offset = offset or -1
        at = Scalar(place.source, place.line, place.column + max(offset, 0), key)
        if not sign or not key:
            tree.findings.add(at, "is not key=value", code=Code.INVENTORY)
            continue
        where = Scalar(place.source, place.line, at.column + len(key) + 1, value)
        variables[key] = (at, _value(where, tree))
    tree.add_hosts(Scalar(place.source, place.line, place.column, name), group, variables)


def _variable(place: Scalar, group: str, tree: HostTree) -> None:
    key, sign, value = place.text.partition("=")
    if not sign or not key.strip():
        tree.findings.add(place, "is not key=value", code=Code.INVENTORY)
        return
    offset = len(key) + 1 + len(value) - len(value.lstrip())
    where = Scalar(place.source, place.line, place.column + offset, value.strip())
    at = Scalar(place.source, place.line, place.column, key.strip())
    tree.group(group).variables[key.strip()] = (at, _value(where, tree))


def _value(place: Scalar, tree: HostTree) -> Node:
    """Read a value as Ansible does: a Python literal where it looks like one, else text."""
    if place.text[:1] not in "[{('\"" or not place.text or len(place.text) > _LONGEST_LITERAL:
        return place
    if not tree.has_room_for_literal(place, len(place.text)):
        return place
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of a backslash before what needs none: they are for whoever wrote it
            literal = ast.literal_eval(place.text)
        return nodes.from_json(literal, place.source, place.line, place.column)
    except nodes.HalfCharacterError as error:
        tree.findings.add(place, str(error), code=Code.INVENTORY)
        return place
    except (ValueError, TypeError, SyntaxError, MemoryError, RecursionError):  # TypeError: a list as a key of a map
        return place
