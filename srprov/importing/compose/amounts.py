"""Durations such as `1m30s` and sizes such as `512m`: text -> numbers -> text, as Compose has them. Pure."""

from __future__ import annotations

import re
from fractions import Fraction

_PART = re.compile(r"([0-9]*(?:\.[0-9]*)?)(w|d|h|m|s|ms|us|µs|μs|ns)(?![a-zµμ])", re.ASCII)
_NANO = {"ns": 1, "us": 10**3, "µs": 10**3, "μs": 10**3, "ms": 10**6, "s": 10**9}
_NANO |= {"m": 60 * 10**9, "h": 3600 * 10**9, "d": 86_400 * 10**9, "w": 7 * 86_400 * 10**9}
_LONGEST = 2**63 - 1
_DIGITS = re.compile(r"\+?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]{1,3})?", re.ASCII)
_UNIT = re.compile("(?<=[kmgtp])i?b")
_POWERS = {"": 0, "b": 0, "k": 1, "m": 2, "g": 3, "t": 4, "p": 5}


def nanoseconds(text: str) -> int:
    """Return a duration: numbers with units from `ns` to `w`, one after the other, or `0`.

    Raises:
        ValueError: It is none, or longer than 292 years.
    """
    sign, bare = (-1, text[1:]) if text[:1] == "-" else (1, text.removeprefix("+"))
    if bare == "0":
        return 0
    total, at = Fraction(0), 0
    while at < len(bare) and (part := _PART.match(bare, at)) and part[1] not in ("", ".") and len(part[1]) < 40:
        total += int(Fraction(f"0{part[1]}" if part[1][0] == "." else part[1].rstrip(".")) * _NANO[part[2]])
        at = part.end()
    if not bare or at < len(bare) or total > _LONGEST:
        raise ValueError(f"'{text[:60]}' is no duration such as 1m30s")
    return sign * int(total)


def show_duration(nano: int) -> str:
    """Return a duration as Compose prints it: `1m30s`, `500ms`, `0s`."""
    sign, nano = ("-" if nano < 0 else ""), abs(nano)
    if nano < 10**9:
        for unit, size in (("ms", 10**6), ("µs", 10**3), ("ns", 1)):
            if nano >= size:
                return f"{sign}{_decimal(nano, size)}{unit}"
        return "0s"
    minutes, rest = divmod(nano, 60 * 10**9)
    hours, minutes = divmod(minutes, 60)
    text = f"{_decimal(rest, 10**9)}s"
    if hours or minutes:
        text = f"{minutes}m{text}"
    return sign + (f"{hours}h{text}" if hours else text)


def _decimal(number: int, size: int) -> str:
    whole, part = divmod(number, size)
    digits = str(part).zfill(len(str(size)) - 1).rstrip("0") if part else ""
    return f"{whole}.{digits}" if digits else str(whole)


def size(text: str) -> int:
    """Return bytes: a number, perhaps with a unit of powers of 1024 (`k`, `mb`, `GiB`).

    Raises:
        ValueError: It is none.
    """
    cut = max(text.rfind(char) for char in "0123456789. ")
    digits, unit = text[: cut + 1].removesuffix(" "), text[cut + 1 :].lower()
    power = _POWERS.get(_UNIT.sub("", unit))
    if power is None or not _DIGITS.fullmatch(digits) or len(digits) > 60:
        raise ValueError(f"'{text[:60]}' is no size such as 512m")
    amount = float(digits) * 1024**power
    if amount >= 2**63:
        raise ValueError(f"'{text[:60]}' is larger than any machine")
    return int(amount)
