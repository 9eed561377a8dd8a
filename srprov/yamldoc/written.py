"""How a document is written, as values: each scalar as it stands there, and where the comments are. Pure."""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

BLOCK_HEADER = re.compile(r"[|>]([0-9+-]*)")


@dataclass
class Written:
    """A value as it is written."""

    prefix: str = ""
    """Its anchor and tag."""
    beside: str = ""
    """The comment behind it; of a map or list in block style, behind what stands before it."""


@dataclass
class Words(Written):
    """A scalar, or an alias."""

    lines: list[str] = field(default_factory=list)
    """As in the source; of a block scalar its content without its indentation."""
    style: str = ""
    """`'`, `"`, `|`, `>`, `*` for an alias, or nothing for a plain one."""
    value: str = ""


@dataclass
class Entry:
    """A value in a map or list."""

    value: Written
    key: Words | None = None
    above: list[str] = field(default_factory=list)
    """Comments before it, and an empty text for empty lines."""


@dataclass
class Group(Written):
    """A map or a list."""

    is_map: bool = True
    flow: bool = False
    entries: list[Entry] = field(default_factory=list)
    end: list[str] = field(default_factory=list)
    """Comments behind the last entry."""
    commented: bool = False
    """There are comments inside."""


@dataclass
class Document:
    """A whole file."""

    root: Written
    head: list[str]
    """Comments before everything."""
    marked: bool
    """It begins with `---`."""
    end: list[str]
    anchors: bool


def split(text: str) -> list[str]:
    """Return the lines of a text, whatever ends them."""
    return text.replace("\r\n", "\n").replace("\r", "\n").removesuffix("\n").split("\n")


def found_comments(lines: list[str], scalars: list[Any]) -> Iterator[tuple[int, tuple[int, str]]]:
    """Return each comment's line, column and words: a `#` that is in no scalar."""
    taken: dict[int, list[tuple[int, int]]] = {}
    signs = [number for number, line in enumerate(lines) if "#" in line]
    for one in scalars:
        start, end = one.start_mark, one.end_mark
        block = one.style in ("|", ">")
        header = BLOCK_HEADER.match(lines[start.line], start.column) if block else None
        # what stands where a block scalar ends is no part of it
        for number in signs[bisect_left(signs, start.line) : bisect_left(signs, end.line + (not block))]:
            first = start.column if number == start.line else 0
            last = end.column if number == end.line else len(lines[number])
            if block and number == start.line:
                last = header.end() if header else first
            taken.setdefault(number, []).append((first, last))
    for number in signs:
        line = lines[number]
        spans = iter(taken.get(number, ()))  # in their order, as they stand in the line
        first, last = next(spans, (len(line), 0))
        at = line.find("#")
        while at >= 0:
            while first < len(line) and last <= at:
                first, last = next(spans, (len(line), 0))
            if at < first:
                yield number, (at, line[at:].rstrip())
                break
            at = line.find("#", last)
