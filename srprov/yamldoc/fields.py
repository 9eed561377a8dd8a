"""Typed fields of a small YAML document that has no JSON Schema: each method reads one node or notes what is wrong.

Takes a document's text; collects every problem with its place. Pure.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from srprov.codes import Code
from srprov.errors import did_you_mean
from srprov.yamldoc import loader, nodes
from srprov.yamldoc.nodes import Findings, Map, Node, Scalar, Seq, Source

_SIZE = re.compile(r"([0-9]+(?:\.[0-9]+)?)\s*([bkmgt]?)(?:i?b)?", re.ASCII | re.IGNORECASE)
_BYTES = {"": 1, "b": 1, "k": 1024, "m": 1024**2, "g": 1024**3, "t": 1024**4}


def size_in_bytes(text: str) -> int:
    """Read `512m`, `4G` or `4GiB` as bytes; units are powers of 1024, as Docker reads them.

    Raises:
        ValueError: It is no size.
    """
    match = _SIZE.fullmatch(text.strip())
    if match is None or len(text) > 40:
        raise ValueError(f"'{text[:40]}' is not a size such as 512m")
    size = int(float(match[1]) * _BYTES[match[2].lower()])
    if size > nodes.LARGEST_INTEGER:
        raise ValueError(f"'{text[:40]}' is more than any machine has")
    return size


class FieldReader:
    """Reads one document; `findings` holds what was wrong with it so far."""

    def __init__(self, text: str, file: str) -> None:
        """Parse the text; `file` is its name in messages.

        Raises:
            DefinitionError: It is not YAML, holds a key twice, or breaks a limit.
        """
        self.findings = Findings()
        self.root: Node = loader.parse(text, file) or Map(Source(file), 1, 1)

    def problem(self, node: Node, message: str, hint: str = "", code: Code = Code.WRONG_VALUE) -> None:
        """Note a problem at a node."""
        self.findings.add(node, message, hint=hint, code=code)

    def _expected(self, node: Node, what: str) -> None:
        shown = f"'{node.text[:60]}'" if isinstance(node, Scalar) and node.text else nodes.kind(node)
        self.problem(node, f"expected {what}, not {shown}", code=Code.WRONG_TYPE)

    def mapping(self, node: Node, known: Sequence[str] = ()) -> Iterator[tuple[Scalar, Node]]:
        """Yield keys and values; a key that is not `known` is a problem and left out."""
        if not isinstance(node, Map):
            self._expected(node, "a map")
            return
        for name, value in node.entries.items():
            if known and name not in known:
                hint = did_you_mean(name, known) or f"known: {', '.join(known)}"
                self.problem(node.keys[name], f"unknown key '{name[:60]}'", hint, Code.UNKNOWN_KEY)
            else:
                yield node.keys[name], value

    def sequence(self, node: Node) -> Sequence[Node]:
        """Return the items of a list."""
        if isinstance(node, Seq):
            return node.items
        self._expected(node, "a list")
        return ()

    def string(self, node: Node) -> str:
        """Return a scalar's text; empty and null are problems."""
        text = _text(node)
        if not text or nodes.is_null(node):
            self._expected(node, "text")
        return text

    def integer(self, node: Node, least: int, most: int) -> int | None:
        """Return a whole number from `least` to `most`."""
        value = nodes.as_int(node)
        if value is None or not least <= value <= most:
            self._expected(node, f"a whole number from {least} to {most}")
            return None
        return value

    def number(self, node: Node, least: float, most: float) -> float | None:
        """Return a number from `least` to `most`."""
        value = nodes.as_number(node)
        if value is None or not least <= value <= most:
            self._expected(node, f"a number from {least} to {most}")
            return None
        return value

    def size(self, node: Node) -> int | None:
        """Return bytes, as `size_in_bytes` reads them."""
        try:
            return size_in_bytes(_text(node))
        except ValueError:
            self._expected(node, "a size such as 512M or 4G")
            return None

    def boolean(self, node: Node) -> bool | None:
        """Return a boolean, in YAML 1.1's spellings too."""
        value = nodes.as_bool(node)
        if value is None:
            self._expected(node, "true or false")
        return value

    def choice(self, node: Node, choices: Sequence[str]) -> str | None:
        """Return one of the words."""
        if _text(node) in choices:
            return _text(node)
        self._expected(node, f"one of {', '.join(choices)}")
        return None


def _text(node: Node) -> str:
    return node.text if isinstance(node, Scalar) else ""
