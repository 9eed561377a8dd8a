"""What the text of a TOML file tells beside its values: where a key stands, and whether it is read in time. Pure."""

from __future__ import annotations

import functools
import re
from collections.abc import Mapping

_MOST_PARTS, _MOST_WORK = 64, 4_000_000
"""Dots in a table's name, and the sum of the squares of those in all lines: Python's reader of TOML looks at each part
of a key again for each part of it, and at those of a table's name for each line in it."""
_HEADER = re.compile(r"\s*\[([^\[\]]+)\]\s*(?:#.*)?")
_KEY = re.compile(r"""\s*(?:"([^"]*)"|'([^']*)'|([^\s"'.=#\[\]]+))\s*[.=]""")


def check_parts(text: str) -> None:
    """Refuse keys that it would take for ever to read.

    Raises:
        ValueError: Names the line.
    """
    lines = {number: line for number, line in enumerate(text.split("\n"), 1) if "." in line}
    dots = {number: line.count(".") for number, line in lines.items()}
    if sum(count * count for count in dots.values()) > _MOST_WORK:
        raise ValueError(f"line {max(dots, key=dots.__getitem__)} has more dots than any key or path")
    for number, count in dots.items():
        if count > _MOST_PARTS and lines[number].lstrip().startswith("["):
            raise ValueError(f"line {number} has more parts than the name of any table")


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
