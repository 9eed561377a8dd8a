"""A template's text -> texts without Jinja2 that have the same places, so that YAML can be checked before rendering.

A substitution becomes one placeholder character, a block or comment becomes blanks, line ends stay: what stands at a
line and column of the template stands there in the skeleton. Of an `if` only one branch can stand in a skeleton, so
there is one skeleton for the first branches, one for the second ones, and so on. Pure.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import msgspec

HOLE = "\ue000"
"""Stands where a substitution begins."""
MARK = "\ue001"
"""Encloses the place of a key, see `marked`."""

BLOCKS = ("if", "elif", "else", "endif", "for", "endfor", "set")
_OPENERS = {"{{": "}}", "{%": "%}", "{#": "#}"}
_OPENING = re.compile(r"\{\{|\{%|\{#")
_WORD = re.compile(r"[-+]?\s*(\w*)")
_MOST_BRANCHES = 8
_MARKED = re.compile(f"{MARK}([0-9]+)_([0-9]+){MARK}")


class Piece(msgspec.Struct, frozen=True):
    """A part of a template: `text`, `value`, `block` or `comment`, from one offset to another."""

    kind: str
    start: int
    end: int
    word: str = ""
    """Of a block, its first word."""


@dataclass(slots=True)
class _Frame:
    branches: int = 1
    current: int = 0


def pieces(text: str) -> list[Piece]:
    """Cut a template; one that Jinja2 does not accept comes to an end, too."""
    found, at = [], 0
    while match := _OPENING.search(text, at):
        begin, opener = match.start(), match.group()
        end = _end_of_comment(text, begin) if opener == "{#" else _end(text, begin + 2, _OPENERS[opener])
        if begin > at:
            found.append(Piece("text", at, begin))
        kind = {"{{": "value", "{%": "block", "{#": "comment"}[opener]
        word = _WORD.match(text, begin + 2)
        found.append(Piece(kind, begin, end, word.group(1) if word and kind == "block" else ""))
        at = end
    if at < len(text):
        found.append(Piece("text", at, len(text)))
    return found


def _end_of_comment(text: str, at: int) -> int:
    end = text.find("#}", at + 2)
    return end + 2 if end >= 0 else len(text)


def _end(text: str, at: int, closer: str) -> int:
    """Find the end of a tag: its closer outside of strings and brackets."""
    depth = 0
    while at < len(text):
        letter = text[at]
        if depth == 0 and text.startswith(closer, at):
            return at + 2
        if letter in "\"'":
            at += 1
            while at < len(text) and text[at] != letter:
                at += 2 if text[at] == "\\" else 1
        elif letter in "([{":
            depth += 1
        elif letter in ")]}":
            depth -= 1
        at += 1
    return len(text)


def skeletons(text: str) -> Iterator[str]:
    """Return the template's text without Jinja2, once for each place in the longest `if`."""
    parts = pieces(text)
    totals = _branches(parts)
    for wanted in range(min(max([1, *totals.values()]), _MOST_BRANCHES)):
        yield _skeleton(text, parts, totals, wanted)


def _branches(parts: list[Piece]) -> Mapping[int, int]:
    """Return, for the index of each piece that opens an `if` or `for`, how many branches it has."""
    totals: dict[int, int] = {}
    open_at: list[int] = []
    for index, part in enumerate(parts):
        if part.word in ("if", "for"):
            open_at.append(index)
            totals[index] = 1
        elif part.word in ("elif", "else") and open_at:
            totals[open_at[-1]] += 1
        elif part.word in ("endif", "endfor") and open_at:
            open_at.pop()
    return totals


def _skeleton(text: str, parts: list[Piece], totals: Mapping[int, int], wanted: int) -> str:
    frames: list[_Frame] = []
    out = []
    for index, part in enumerate(parts):
        here = text[part.start : part.end]
        if part.word in ("if", "for"):
            frames.append(_Frame(branches=totals[index]))
        elif part.word in ("elif", "else") and frames:
            frames[-1].current += 1
        elif part.word in ("endif", "endfor") and frames:
            frames.pop()
        shown = all(frame.current == min(wanted, frame.branches - 1) for frame in frames)
        if part.kind == "text" and shown:
            out.append(here)
        else:
            blank = re.sub(r"[^\n]", " ", here)
            out.append(HOLE + blank[1:] if part.kind == "value" and shown else blank)
    return "".join(out)


def marked(text: str, places: Iterator[tuple[int, int]]) -> str:
    """Write before each key, given by line and column, its place into it; `unmarked` takes it out again."""
    lines = text.split("\n")
    for line, column in sorted(set(places), reverse=True):
        row = lines[line - 1]
        at = column - 1 + (row[column - 1 : column] in ("'", '"'))
        lines[line - 1] = f"{row[:at]}{MARK}{line}_{column}{MARK}{row[at:]}"
    return "\n".join(lines)


def unmarked(key: str) -> tuple[str, int, int]:
    """Return a key as it was written, its line and its column; 0 where it carries no mark."""
    found = _MARKED.match(key)
    return (key[found.end() :], int(found[1]), int(found[2])) if found else (key, 0, 0)
