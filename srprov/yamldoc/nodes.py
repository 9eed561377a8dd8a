"""The document as it was written: maps, lists and scalars that know their place in the file.

Takes what `loader` has read; gives `Node`s, and `Diagnostic`s that point at them. Touches nothing. A scalar
keeps its source text: whether `on` is a word or a boolean is decided by who asks for it, so `as_bool` and `text` can
both be right.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping

import msgspec
from msgspec.structs import replace

from srprov.codes import Code
from srprov.errors import DefinitionError, Diagnostic, Location

_TRUE = {"true", "yes", "on"}
_FALSE = {"false", "no", "off"}
_NULL = {"", "~", "null", "Null", "NULL"}
_INTEGER = re.compile(r"[-+]?(0|[1-9][0-9]*)|0x[0-9a-fA-F]+|0o[0-7]+", re.ASCII)
_NUMBER = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?", re.ASCII)
_SECRET = re.compile(r"pass|secret|token|credential|api_?key", re.IGNORECASE)
_HALF = re.compile("[\ud800-\udfff]")
_LONGEST_NUMBER = 40
"""Longer digits are no sensible figure, and Python refuses to read very long ones."""
LARGEST_INTEGER = 2**63 - 1
"""What Docker and the kernel take; a larger one is no number to us."""
_MOST_PROBLEMS = 100
"""Of one document. Whoever has more has one mistake in many places, or wants to keep srprov busy."""

Path = tuple[str | int, ...]


class Source(msgspec.Struct, frozen=True, eq=False):
    """One file that was read: its name as the user gave it, and its lines for excerpts."""

    file: str
    lines: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """What was read, with line feeds at the ends of lines."""
        return "\n".join(self.lines)

    @property
    def folder(self) -> str:
        """Absolute path of the folder that relative paths in this file start from."""
        return os.path.dirname(os.path.abspath(self.file))

    def excerpt(self, line: int) -> str:
        """Return one line (counted from 1) without its end, or nothing."""
        return self.lines[line - 1] if 0 < line <= len(self.lines) else ""


class Scalar(msgspec.Struct, frozen=True, eq=False):
    """A word, number or text; `plain` is false for quoted and block text, which is never a number, boolean or null."""

    source: Source
    line: int
    column: int
    text: str
    plain: bool = True
    tag: str = ""
    """An explicit tag other than YAML's own, e.g. `!vault`."""


class Seq(msgspec.Struct, frozen=True, eq=False):
    """A list."""

    source: Source
    line: int
    column: int
    items: tuple[Node, ...] = ()
    tag: str = ""


class Map(msgspec.Struct, frozen=True, eq=False):
    """A map; `keys` holds where each key is written."""

    source: Source
    line: int
    column: int
    entries: Mapping[str, Node] = msgspec.field(default_factory=dict)
    keys: Mapping[str, Scalar] = msgspec.field(default_factory=dict)
    tag: str = ""


Node = Scalar | Seq | Map


def without_secrets(one: Diagnostic) -> Diagnostic:
    """Leave the source line out where it may hold a password: files with secrets are shown in terminals and CI logs."""
    return replace(one, excerpt="") if _SECRET.search(one.excerpt) else one


def location(node: Node) -> Location:
    """Return the place where a node begins."""
    return Location(node.source.file, node.line, node.column)


def problem(node: Node, message: str, path: Path | str = (), hint: str = "", *, code: Code) -> Diagnostic:
    """Return a problem that points at a node; `path` is where it stands inside the document."""
    where = path if isinstance(path, str) else dotted(path)
    return Diagnostic(location(node), message, where, node.source.excerpt(node.line), hint, code=code)


def dotted(path: Path) -> str:
    """Return a path as it is shown: `services.talker.ports.0`."""
    return ".".join(str(part) for part in path)


def key_or_value(parent: Map, key: str) -> Node:
    """Return the place of a key, for problems about the whole entry."""
    return parent.keys.get(key, parent)


def find(node: Node, path: Path) -> Node:
    """Return the node that a path leads to, or the last one on the way that exists."""
    for part in path:
        if isinstance(node, Map) and str(part) in node.entries:
            node = node.entries[str(part)]
        elif isinstance(node, Seq) and isinstance(part, int) and part < len(node.items):
            node = node.items[part]
        else:
            break
    return node


def is_null(node: Node) -> bool:
    """Return whether nothing was written: an empty value, `~` or `null`."""
    return isinstance(node, Scalar) and node.plain and not node.tag and node.text in _NULL


def as_bool(node: Node) -> bool | None:
    """Read a boolean where one is wanted (YAML 1.1's words count); anything else is None."""
    if not isinstance(node, Scalar) or not node.plain or node.text.lower() not in _TRUE | _FALSE:
        return None
    return node.text.lower() in _TRUE


def as_int(node: Node) -> int | None:
    """Read a whole number; None for anything else, also for `0644`, which YAML 1.1 and 1.2 read differently."""
    if not isinstance(node, Scalar) or not node.plain or len(node.text) > _LONGEST_NUMBER:
        return None
    value = int(node.text, 0) if _INTEGER.fullmatch(node.text) else None
    return value if value is None or abs(value) <= LARGEST_INTEGER else None


def as_number(node: Node) -> float | None:
    """Read a finite number; anything else is None."""
    whole = as_int(node)
    if whole is not None:
        return float(whole)
    if not isinstance(node, Scalar) or not node.plain or len(node.text) > _LONGEST_NUMBER:
        return None
    value = float(node.text) if _NUMBER.fullmatch(node.text) else float("inf")
    return value if abs(value) != float("inf") else None


def kind(node: Node) -> str:
    """Name what a node is, for messages."""
    if isinstance(node, Map):
        return "a map"
    if isinstance(node, Seq):
        return "a list"
    if is_null(node):
        return "nothing"
    if as_bool(node) is not None:
        return f"the boolean {node.text}"
    return f"the number {node.text[:40]}" if as_number(node) is not None else "text"


class Findings:
    """Gathers problems, each with its place in the document, so that later checks leave broken parts alone."""

    def __init__(self) -> None:
        """Begin with nothing found."""
        self._found: dict[Diagnostic, Path] = {}

    def copy(self) -> Findings:
        """Return the same problems at the same places, to add others to."""
        findings = Findings()
        findings._found = dict(self._found)
        return findings

    def add(self, node: Node, message: str, path: Path = (), hint: str = "", *, code: Code) -> None:
        """Add one problem at a node; the same one twice counts once.

        Raises:
            DefinitionError: There are so many that nobody reads further ones; with those that were found.
        """
        self._found.setdefault(problem(node, message, path, hint, code=code), path)
        self._stop_at_many()

    def extend(self, problems: Iterable[Diagnostic]) -> None:
        """Add problems that concern no place of this document."""
        for one in problems:
            self._found.setdefault(one, ("",))
            self._stop_at_many()

    def _stop_at_many(self) -> None:
        if len(self._found) > _MOST_PROBLEMS:
            *shown, last = self._found
            hint = f"there are more than {_MOST_PROBLEMS} problems; no further ones are looked for"
            raise DefinitionError([*shown, replace(last, hint=hint)])

    def broken(self, path: Path) -> bool:
        """Return whether something at or below a place is wrong."""
        return any(found[: len(path)] == path for found in self._found.values())

    @property
    def problems(self) -> list[Diagnostic]:
        """Everything found so far."""
        return list(self._found)


class HalfCharacterError(ValueError):
    """A text has half of a surrogate pair, which no file or command can."""


def from_json(value: object, source: Source, line: int = 1, column: int = 1) -> Node:
    """Return nodes for a JSON value (an executable inventory's answer), all at one place.

    Raises:
        ValueError: It is nested too deeply, or holds what JSON cannot; as HalfCharacterError, what YAML cannot.
    """
    return _from_json(value, source, line, column, 0)


def _from_json(value: object, source: Source, line: int, column: int, depth: int) -> Node:
    if depth > 60:
        raise ValueError("nested too deeply")
    if isinstance(value, dict):
        entries = {_whole(str(key)): _from_json(item, source, line, column, depth + 1) for key, item in value.items()}
        return Map(source, line, column, entries, {key: Scalar(source, line, column, key) for key in entries})
    if isinstance(value, list | tuple | set):
        return Seq(source, line, column, tuple(_from_json(item, source, line, column, depth + 1) for item in value))
    text = "null" if value is None else str(value).lower() if isinstance(value, bool) else str(value)
    return Scalar(source, line, column, _whole(text), plain=not isinstance(value, str))


def _whole(text: str) -> str:
    if _HALF.search(text):
        raise HalfCharacterError("a text has half a character, which is no UTF-8")
    return text
