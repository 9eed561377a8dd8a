"""Numbers, sizes, times and names as pages say them. Pure."""

from __future__ import annotations

import datetime as dt
import math
import re
from collections.abc import Iterable, Sequence

from srprov.names import few
from srprov.report.html import Html, el

_UNITS = ("bytes", "KiB", "MiB", "GiB", "TiB")
_NUMBERED = re.compile(r"(.*?)(\d{1,9})", re.ASCII | re.DOTALL)
_KIBI = 1024
_SHORT = 12


def number(value: float, shown: str | None = None, *, of: str | None = None) -> Html:
    """Return a number with its exact value.

    Args:
        value: As the file has it.
        shown: How people read it; without it, as it is.
        of: The JSON pointer of the value in the data of the page.
    """
    exact = exactly(value)
    return el("data", exact if shown is None else shown, value=exact, data_of=of)


def exactly(value: float) -> str:
    """Return a number as JSON writes it."""
    return str(value) if isinstance(value, int) or math.isfinite(value) else "no number"


def seconds(value: float, *, of: str | None = None) -> Html:
    """Return a time in seconds, in milliseconds' detail."""
    return number(value, f"{value:.3f} s" if abs(value) < 100 else f"{value:.1f} s", of=of)


def size(value: int, *, of: str | None = None) -> Html:
    """Return a number of bytes."""
    left, unit = float(value), 0
    while left >= _KIBI and unit < len(_UNITS) - 1:
        left, unit = left / _KIBI, unit + 1
    return number(value, f"{value} bytes" if unit == 0 else f"{left:.1f} {_UNITS[unit]}", of=of)


def counted(count: int, noun: str) -> str:
    """Return a number of things, such as `1 step` or `2 steps`."""
    return f"{count} {noun}{'s' * (count != 1)}"


def pointer(*parts: str | int) -> str:
    """Return a JSON pointer. Source: RFC 6901."""
    return "".join("/" + str(one).replace("~", "~0").replace("/", "~1") for one in parts)


def natural(name: str) -> tuple[str, int, str]:
    """Return what orders names so that robot2 comes before robot10."""
    digits = name[len(name.rstrip("0123456789")) :][:9]
    return name[: len(name) - len(digits)], int(digits or 0), name


def ranges(names: Iterable[str], most: int = _SHORT) -> str:
    """Return names with neighbours folded, such as `robot[1-4], base`; of many, the first and how many more."""
    found: list[str] = []
    run: list[tuple[str, str]] = []
    for name in sorted(set(names), key=natural):
        fits = _NUMBERED.fullmatch(name)
        here = (fits[1], fits[2]) if fits else (name, "")
        if run and fits and run[-1][1] and here[0] == run[-1][0] and int(here[1]) == int(run[-1][1]) + 1:
            run.append(here)
            continue
        found += _folded(run)
        run = [here]
    found += _folded(run)
    return few(found, most)


def _folded(run: Sequence[tuple[str, str]]) -> list[str]:
    if len(run) > 2:
        return [f"{run[0][0]}[{run[0][1]}-{run[-1][1]}]"]
    return [f"{begin}{digits}" for begin, digits in run]


def moment(stamp: str) -> Html:
    """Return an ISO 8601 time in UTC for people; what is none stays as it is."""
    try:
        when = dt.datetime.fromisoformat(stamp).astimezone(dt.timezone.utc)
    except (ValueError, OverflowError):
        return el("span", stamp)
    return el("time", f"{when:%Y-%m-%d %H:%M:%S} UTC", datetime=f"{when:%Y-%m-%dT%H:%M:%SZ}")
