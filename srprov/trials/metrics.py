"""A trial's logs and result files -> its metrics. Pure."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping

from srprov.definitions.trialsmodel import Metric
from srprov.linear_regex import compiled
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


def matches(lines: Iterable[str], pattern: str) -> bool:
    """Return whether some line matches."""
    search = compiled(pattern).search
    return any(search(line[:LONGEST_LINE]) for line in lines)


def from_log(lines: Iterable[str], metric: Metric) -> float | None:
    """Return the number that a log's matching lines give together; None without any, but for `count`."""
    search = compiled(metric.pattern).search
    found = [match for line in lines if (match := search(line[:LONGEST_LINE]))]
    if metric.reduce == "count":
        return float(len(found))
    numbers = [value for match in found if (value := _number(match.group(1) or "")) is not None]
    if not numbers:
        return None
    if metric.reduce == "first":
        return numbers[0]
    if metric.reduce == "last":
        return numbers[-1]
    total = math.fsum(numbers)
    return _finite(
        {"sum": total, "min": min(numbers), "max": max(numbers), "mean": total / len(numbers)}[metric.reduce]
    )


def _number(text: str) -> float | None:
    return _finite(float(text)) if len(text) < 400 and _NUMBER.fullmatch(text) else None


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
