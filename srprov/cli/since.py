"""What `--since` says: how long ago, or a moment."""

from __future__ import annotations

import datetime as dt
import re
import time

import click

_AGO = re.compile(r"(?=\d)(?:(\d{1,6})d)?(?:(\d{1,6})h)?(?:(\d{1,6})m)?(?:(\d{1,9})s?)?", re.ASCII)
_UNITS = (86_400, 3600, 60, 1)


def since(_context: click.Context, _option: click.Parameter, text: str | None) -> float | None:
    """Return seconds since the epoch; `1h30m` is before now, and a moment without an offset is this machine's time.

    Raises:
        BadParameter: It is neither.
    """
    if text is None:
        return None
    if ago := _AGO.fullmatch(text):
        seconds = sum(int(count or 0) * unit for count, unit in zip(ago.groups(), _UNITS, strict=True))
        return max(0.0, time.time() - seconds)
    try:
        return max(0.0, dt.datetime.fromisoformat(re.sub(r"[Zz]\Z", "+00:00", text)).timestamp())
    except (ValueError, OverflowError, OSError):
        said = f"{text[:60]!r} is neither a time ago (10m, 1h30m) nor a moment (2026-11-22T10:00:00Z)."
        raise click.BadParameter(said) from None
