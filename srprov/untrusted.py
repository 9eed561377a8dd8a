"""What robots say, made harmless: text without control characters, numbers in their bounds, lists of a sane length.

Takes any text or JSON value; gives a value of the type that was asked for, never an exception. A robot may be broken or
hostile: its facts end on terminals, in file names and in sums that decide who runs what. Touches nothing.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from typing import Any

TEXT_LENGTH = 200
"""Characters that a fact may have."""
LIST_LENGTH = 1024
"""Entries that a list of facts may have: links, routes, devices."""

_INTEGER = re.compile(r"-?[0-9]{1,18}")
_DECIMAL = re.compile(r"-?[0-9]{1,18}(\.[0-9]{1,18})?")


def text(value: object, *, length: int = TEXT_LENGTH) -> str:
    """Return one printable line of at most `length` characters, no control or bidi ones; what is not text is ""."""
    if not isinstance(value, str):
        return ""
    # cut first: a robot may send megabytes, and only a few characters of them can matter
    return "".join(c for c in value[: 4 * length] if c.isprintable())[:length].strip()


def folder(value: object) -> str:
    """Return an absolute path as `text` does; what is none is ""."""
    said = text(value)
    return said if said.startswith("/") else ""


def lines_of(out: str, most: int) -> list[str]:
    """Return at most `most` lines. Only a line feed ends one; str.splitlines would also take a form feed."""
    return out.split("\n", most)[:most]


def integer(value: object, *, low: int, high: int, default: int) -> int:
    """Return an int clamped to `low..high`; `default` when it is no number at all."""
    if isinstance(value, str) and _INTEGER.fullmatch(value.strip()):
        value = int(value)
    if isinstance(value, bool) or not isinstance(value, int):
        return default
    return max(low, min(high, value))


def decimal(value: object, *, low: float, high: float, default: float) -> float:
    """Return a finite float clamped to `low..high`; `default` when it is no number, NaN or infinite."""
    if isinstance(value, str) and _DECIMAL.fullmatch(value.strip()):
        value = float(value)
    if isinstance(value, bool) or not isinstance(value, int | float):
        return default
    try:
        number = float(value)
    except OverflowError:
        return default
    return float(max(low, min(high, number))) if math.isfinite(number) else default


def parsed(source: str) -> Any:  # noqa: ANN401 - JSON is any; each parser checks the shape that it needs
    """Return JSON as values; broken or too deeply nested JSON is None.

    `ip -j` writes control characters of a link's name or alias as they are: one odd link must not hide all others.
    """
    try:
        return json.loads(source, strict=False)
    except (ValueError, RecursionError):
        return None


def mapping(value: object) -> Mapping[str, Any]:
    """Return the mapping, or an empty one for anything else."""
    return value if isinstance(value, Mapping) else {}


def mappings(value: object) -> list[Mapping[str, Any]]:
    """Return the mappings in a list, at most `LIST_LENGTH` of them; anything else is left out."""
    return [item for item in value if isinstance(item, Mapping)][:LIST_LENGTH] if isinstance(value, list) else []
