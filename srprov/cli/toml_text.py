"""What the text of a TOML file tells beside its values: where a key stands, and whether it is read in time. Pure."""

from __future__ import annotations

import functools
import re
from collections.abc import Mapping

_MOST_PARTS, _MOST_WORK = 64, 2_000_000
"""Dots in a table's name; and parts that are looked at in all lines: for each part of a key, Python's reader of TOML
goes through those of the key again, and through those of its table's name. Which table a line is in cannot be told
before it is read, so that the longest name counts."""
MOST_BYTES = 1 << 18
"""Of a file that srprov takes apart; a long list of short values takes the reader two microseconds a byte."""
_HEADER = re.compile(r"\s*\[([^\[\]]+)\]\s*(?:#.*)?")
_KEY = re.compile(r"""\s*(?:"([^"]*)"|'([^']*)'|([^\s"'.=#\[\]]+))\s*[.=]""")


def check_parts(text: str) -> None:
    """Refuse a text that it would take for ever to read.

    Raises:
        ValueError: Names the line.
    """
    if len(text) > MOST_BYTES:
        raise ValueError(f"it is longer than {MOST_BYTES >> 10} KiB")
    all_lines = text.split("\n")
    dots = {number: one.count(".") for number, one in enumerate(all_lines, 1) if one.strip()}
    tables = {number: count for number, count in dots.items() if all_lines[number - 1].lstrip().startswith("[")}
    longest = max(tables.values(), default=0)
    if longest > _MOST_PARTS:
        place = max(tables, key=tables.__getitem__)
        raise ValueError(f"line {place} has more parts than the name of any table")
    if sum((count + 1) * (count + 1 + longest) for count in dots.values()) > _MOST_WORK:
        raise ValueError(f"with line {max(dots, key=dots.__getitem__)}, it has more dots than keys and paths have")


def line(text: str, table: str, key: str) -> int:
    """Return the line of a key in a table, or with an empty key of the table's header; 1 where it cannot be told."""
    return _lines(text).get((table, key), 1)


@functools.lru_cache(maxsize=4)
def _lines(text: str) -> Mapping[tuple[str, str], int]:
    """Return table and key -> line, of a text that is gone through once."""
    found: dict[tuple[str, str], int] = {}
    current = ""
    for number, one in enumerate(text.splitlines(), 1):
        if header := _HEADER.fullmatch(one):
            current = header[1].strip()
            found.setdefault((current, ""), number)
        elif match := _KEY.match(one):
            found.setdefault((current, match[1] or match[2] or match[3] or ""), number)
    return found
