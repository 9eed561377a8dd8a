"""Whether a robot may begin a trial: its clock, disk, battery and temperature, compared with limits. Pure."""

from __future__ import annotations

from collections.abc import Callable

import msgspec

from srprov.definitions.trialsmodel import Limits
from srprov.trials.clock import Offset
from srprov.trials.hosts import HostReading

_MIB = 1 << 20


class Finding(msgspec.Struct, frozen=True):
    """What about one robot is surely beyond a limit, or not known well enough to tell."""

    robot: str
    limit: str
    """The key in the EDF."""
    surely: bool
    text: str


def check(limits: Limits, robot: str, clock: Offset | None, reading: HostReading) -> list[Finding]:
    """Return what is beyond a limit, and what cannot be told."""
    found = [
        _clock(limits.clock_offset_s, clock),
        _least("disk_free", limits.disk_free_bytes, reading.disk_free, _size, "of its disk are free"),
        _least("battery", limits.battery_percent, reading.battery_percent, "{} %".format, "are left in its battery"),
        _temperature(limits.temperature_c, reading.temperature_c),
    ]
    return [Finding(robot, limit, surely, f"{robot}: {text}") for limit, surely, text in filter(None, found)]


_Found = tuple[str, bool, str] | None


def _clock(limit: float | None, clock: Offset | None) -> _Found:
    """Compare a clock by its bounds: it is off only when even the least that it can be off is too much."""
    if limit is None:
        return None
    if clock is None:
        return "clock_offset", False, f"its clock may be more than {_ms(limit)} off: it gives no time"
    off = f"its clock is {_ms(abs(clock.offset_s))} off (+-{_ms(clock.error_s)})"
    if abs(clock.offset_s) - clock.error_s > limit:
        return "clock_offset", True, f"{off}, and may be {_ms(limit)}"
    if abs(clock.offset_s) + clock.error_s > limit:
        return "clock_offset", False, f"{off}, so it may be more than {_ms(limit)}"
    return None


def _least(key: str, limit: int | None, value: int | None, shown: Callable[[int], str], what: str) -> _Found:
    if limit is None:
        return None
    if value is None:
        return key, False, f"it does not say how much {what.replace('are', 'is')}"
    return (key, True, f"{shown(value)} {what}, and {shown(limit)} are wanted") if value < limit else None


def _temperature(limit: float | None, value: float | None) -> _Found:
    if limit is None:
        return None
    if value is None:
        return "temperature", False, "it does not say how warm it is"
    return ("temperature", True, f"it has {value:.1f} °C, and may have {limit:g}") if value > limit else None


def _ms(seconds: float) -> str:
    return f"{1000 * seconds:.1f} ms" if abs(seconds) < 1 else f"{seconds:.1f} s"


def _size(value: int) -> str:
    return f"{value / _MIB:.0f} MiB"
