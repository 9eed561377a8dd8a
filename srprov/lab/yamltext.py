"""A YAML document read node by node: every value knows its line, all problems are collected. Pure.

A plain scalar is its source text (`on` is a word, `1.10` is not 1.1); what it means is decided by
the reader of the field.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator, Sequence

import yaml

from srprov.errors import DefinitionError, Diagnostic, Location

UNITS = {"": 1, "K": 2**10, "M": 2**20, "G": 2**30, "T": 2**40}
BOOLEANS = {"true": True, "yes": True, "on": True, "false": False, "no": False, "off": False}


class Node:
    """A node of the document, and its text where it is a scalar."""

    def __init__(self, node: yaml.Node) -> None:
        """Wrap what PyYAML composed."""
        self.node = node
        self.text = node.value if isinstance(node, yaml.ScalarNode) else ""


class Reader:
    """Reads one document; `problems` is what was wrong with it so far."""

    def __init__(self, text: str, file: str) -> None:
        """Parse the text; DefinitionError at once when it is not YAML."""
        self.file = file
        self.lines = text.splitlines()
        self.problems: list[Diagnostic] = []
        try:
            root = yaml.compose(text, Loader=yaml.SafeLoader)
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark
            line, column = (mark.line + 1, mark.column + 1) if mark else (1, 1)
            where = Location(file, line, column)
            raise DefinitionError([Diagnostic(where, f"not YAML: {error.problem}")]) from error
        except yaml.YAMLError as error:
            raise DefinitionError([Diagnostic(Location(file), f"not YAML: {error}")]) from error
        mark = yaml.Mark(file, 0, 0, 0, "", 0)
        empty = yaml.MappingNode("tag:yaml.org,2002:map", [], mark, mark)
        self.root = Node(root or empty)

    def problem(self, node: Node, message: str, hint: str = "") -> None:
        """Note a problem at the node's place."""
        mark = node.node.start_mark
        line = self.lines[mark.line] if mark.line < len(self.lines) else ""
        where = Location(self.file, mark.line + 1, mark.column + 1)
        self.problems.append(Diagnostic(where, message, excerpt=line, hint=hint))

    def is_null(self, node: Node) -> bool:
        """Whether nothing is written there."""
        return bool(node.node.tag == "tag:yaml.org,2002:null")

    def is_mapping(self, node: Node) -> bool:
        """Whether it is a mapping."""
        return isinstance(node.node, yaml.MappingNode)

    def mapping(self, node: Node, known: Sequence[str] = ()) -> Iterator[tuple[Node, Node]]:
        """Keys and values; one that is there twice, or not `known`, is a problem and left out."""
        if not isinstance(node.node, yaml.MappingNode):
            self.problem(node, "a mapping is wanted here")
            return
        seen: set[str] = set()
        for key, value in ((Node(key), Node(value)) for key, value in node.node.value):
            if key.text in seen:
                self.problem(key, f"{key.text!r} is there twice")
            elif known and key.text not in known:
                close = difflib.get_close_matches(key.text, known, 1)
                hint = f"did you mean {close[0]!r}?" if close else f"known: {', '.join(known)}"
                self.problem(key, f"unknown key {key.text!r}", hint)
            else:
                yield key, value
            seen.add(key.text)

    def sequence(self, node: Node) -> list[Node]:
        """The items of a list."""
        if isinstance(node.node, yaml.SequenceNode):
            return [Node(item) for item in node.node.value]
        self.problem(node, "a list is wanted here")
        return []

    def string(self, node: Node) -> str:
        """A scalar's text; empty and null are problems."""
        if not node.text or self.is_null(node):
            self.problem(node, "a text is wanted here")
        return node.text

    def integer(self, node: Node, least: int, most: int) -> int | None:
        """A whole number from `least` to `most`."""
        value = int(node.text) if re.fullmatch(r"[0-9]{1,9}", node.text) else None
        if value is None or not least <= value <= most:
            self.problem(node, f"a whole number from {least} to {most} is wanted here")
            return None
        return value

    def number(self, node: Node, least: float, most: float) -> float | None:
        """A number from `least` to `most`."""
        value = float(node.text) if re.fullmatch(r"-?[0-9]{1,9}(\.[0-9]+)?", node.text) else None
        if value is None or not least <= value <= most:
            self.problem(node, f"a number from {least} to {most} is wanted here")
            return None
        return value

    def size(self, node: Node) -> int | None:
        """Bytes: `512M`, `4G`, `4GiB`; units are powers of 1024."""
        found = re.fullmatch(r"([0-9]{1,15}(?:\.[0-9]+)?) ?([KMGT]?)(?:i?B)?", node.text, re.IGNORECASE)
        if found is None:
            self.problem(node, "a size such as 512M or 4G is wanted here")
            return None
        return int(float(found[1]) * UNITS[found[2].upper()])

    def boolean(self, node: Node) -> bool | None:
        """`true` or `false`, in YAML 1.1's spellings too."""
        value = BOOLEANS.get(node.text.lower())
        if value is None:
            self.problem(node, "true or false is wanted here")
        return value

    def choice(self, node: Node, choices: Sequence[str]) -> str | None:
        """One of the words."""
        if node.text in choices:
            return node.text
        self.problem(node, f"one of {', '.join(choices)} is wanted here")
        return None
