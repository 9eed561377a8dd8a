"""A trial's logs and result files -> its metrics. Pure."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import msgspec

from srprov.definitions.trialsmodel import Metric
from srprov.linear_regex import any_of, compiled
from srprov.untrusted import json_or_none

MOST_BYTES = 8 << 20
"""Of a JSON file that metrics are taken from."""
LONGEST_LINE = 65_536
"""Characters of a log's line that patterns look at."""
_NUMBER = re.compile(r"\s*[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d{1,4})?\s*", re.ASCII)


def from_json(text: str, pointer: str) -> float | None:
    """Return the number, or the truth value as 1 or 0, that a JSON pointer leads to; None where there is none."""
    value = json_or_none(text)
    for part in pointer.split("/")[1:]:
        key = part.replace("~1", "/").replace("~0", "~")
        if isinstance(value, Mapping) and key in value:
            value = value[key]
        elif isinstance(value, list) and re.fullmatch("0|[1-9][0-9]{0,8}", key) and int(key) < len(value):
            value = value[int(key)]
        else:
            return None
    if not isinstance(value, int | float):
        return None
    try:
        return _finite(float(value))
    except OverflowError:
        return None


class Scanned(msgspec.Struct, frozen=True, kw_only=True):
    """What one pass over a log gave."""

    values: Mapping[str, float]
    """Metric -> its number; one without any is left out."""
    first: Mapping[str, str]
    """Pattern -> the engine's time of the first line that matched, as it stands there."""


def _never(_size: int) -> None:
    """Wait for as long as it takes."""


def scan(
    lines: Iterable[tuple[str, str]], metrics: Iterable[Metric], patterns: Iterable[str] = (),
    tick: Callable[[int], None] = _never,
) -> Scanned:  # fmt: skip
    """Read a log once, for all that is wanted of it; in memory is a line at a time.

    Args:
        lines: The engine's time and the text of each.
        metrics: Those of this log.
        patterns: Others that are looked for.
        tick: Called before each search, with the bytes of a line at its first; may raise to end it.
    """
    numbers = [(compiled(one.pattern).search, one, _Reduced(one.reduce)) for one in metrics]
    wanted = [(compiled(pattern).search, pattern) for pattern in dict.fromkeys(patterns)]
    if not numbers and not wanted:
        return Scanned(values={}, first={})
    some = any_of([*(one.pattern for _, one, _ in numbers), *(pattern for _, pattern in wanted)])
    first: dict[str, str] = {}
    for when, text in lines:
        line = text[:LONGEST_LINE].encode("utf-8", "replace")
        tick(len(line))
        if some is not None and not some(line):  # most lines match nothing, which is one search
            continue
        for search, _, reduced in numbers:
            tick(0)
            if match := search(line):
                reduced.add(match)
        for search, pattern in wanted:
            tick(0)
            if pattern not in first and search(line):
                first[pattern] = when
    values = {one.name: value for _, one, reduced in numbers if (value := reduced.value()) is not None}
    return Scanned(values=values, first=first)


_KEPT: Mapping[str, Callable[[float, float], float]] = {
    "first": lambda old, _new: old,
    "last": lambda _old, new: new,
    "min": min,
    "max": max,
}


class _Reduced:
    """One number of many, in memory that does not grow with them."""

    def __init__(self, reduce: str) -> None:
        self._reduce, self._count = reduce, 0
        self._kept: float | None = None
        self._parts: list[float] = []

    def add(self, match: Any) -> None:  # noqa: ANN401 - google-re2 is not typed
        """Take a match; one without a number counts only where matches are counted."""
        if self._reduce == "count":
            self._count += 1
        elif (value := _number((match.group(1) or b"").decode("utf-8", "replace"))) is not None:
            self._count += 1
            if self._reduce in _KEPT:
                self._kept = value if self._kept is None else _KEPT[self._reduce](self._kept, value)
            else:
                _add_exactly(self._parts, value)

    def value(self) -> float | None:
        """Return the number; None without any, but for `count`."""
        if self._reduce == "count":
            return float(self._count)
        if self._reduce in _KEPT or not self._count:
            return self._kept
        try:
            total = math.fsum(self._parts)
        except (OverflowError, ValueError):
            return None
        return _finite(total / self._count if self._reduce == "mean" else total)


def _add_exactly(parts: list[float], value: float) -> None:
    """Add a number to a sum that is kept as parts whose bits do not overlap, of which there are few.

    Source: J. R. Shewchuk, "Adaptive Precision Floating-Point Arithmetic", 1997; it is what `math.fsum` does.
    """
    kept = 0
    for part in parts:
        large, small = (value, part) if abs(value) >= abs(part) else (part, value)
        value = large + small
        if rest := small - (value - large):
            parts[kept] = rest
            kept += 1
    parts[kept:] = [value]


def _number(text: str) -> float | None:
    return _finite(float(text)) if len(text) < 400 and _NUMBER.fullmatch(text) else None


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
