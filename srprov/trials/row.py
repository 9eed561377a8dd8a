"""What the engines say of one attempt of a trial -> its row, with times by the controller's clock. Pure."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping, Sequence

import msgspec

from srprov.trials.clock import Offset, stepped
from srprov.trials.design import Trial
from srprov.trials.judge import End
from srprov.trials.reading import Reading

_LAST_MOMENT = 253_402_300_000.0
"""The end of the year 9999."""


class Seen(msgspec.Struct, frozen=True, kw_only=True):
    """All that is known of an attempt when it is over; times in seconds, by the controller's clock where not said."""

    end: End
    readings: Mapping[str, Reading] = msgspec.field(default_factory=dict)
    """Service -> its container; times by its robot's clock."""
    robots: Mapping[str, str] = msgspec.field(default_factory=dict)
    """Service -> its robot."""
    before: Mapping[str, Offset | None] = msgspec.field(default_factory=dict)
    after: Mapping[str, Offset | None] = msgspec.field(default_factory=dict)
    began: float = 0.0
    ready_s: float = 0.0
    duration_s: float = 0.0
    stop_s: float = 0.0
    matched: Mapping[str, float] = msgspec.field(default_factory=dict)
    """Service -> when its log matched what ended the trial, by its robot's clock."""


def row(trial: Trial, attempt: int, order: int, seen: Seen) -> dict[str, object]:
    """Return the columns that follow from readings; the verdict, metrics and results are for others to add."""
    started = {name: _here(seen, name, one.started) for name, one in seen.readings.items() if one.started}
    by_time = sorted(started, key=started.__getitem__)
    first, last = (by_time[0], by_time[-1]) if by_time else ("", "")
    known = first and last and _offset(seen, first) and _offset(seen, last)
    offsets = [one for one in seen.before.values() if one]
    steps = _steps(seen)
    return {
        "trial": trial.id,
        "point": trial.point.id,
        "repetition": trial.repetition,
        "attempt": attempt,
        "order": order,
        "status": seen.end.status,
        "reason": seen.end.reason,
        "seed": trial.seed,
        **{f"p_{name}": value for name, value in trial.point.values.items()},
        "started_utc": _utc(started[last]) if started else None,
        "ready_s": seen.ready_s if started else None,
        "duration_s": _duration(seen, started.get(last, 0.0)) if started else None,
        "stop_s": seen.stop_s if started else None,
        "start_skew_ms": 1000 * (started[last] - started[first]) if known else None,
        "start_skew_error_ms": 1000 * (_error(seen, first) + _error(seen, last)) if known else None,
        "clock_max_offset_ms": 1000 * max((one.offset_s for one in offsets), key=abs) if offsets else None,
        "clock_error_ms": 1000 * max(one.error_s for one in offsets) if offsets else None,
        "clock_step": any(steps) if steps else None,
        "restarts": sum(one.restarts for one in seen.readings.values()) if seen.readings else None,
    }


def clocks(measured: Sequence[Mapping[str, Offset | None]]) -> list[dict[str, object]]:
    """Return what an attempt's row says of clocks: each robot's before it, and after it where it came so far."""
    return [
        {"robot": robot, "when": when, **_clock(one)}
        for when, found in zip(("before", "after"), measured, strict=False)
        for robot, one in sorted(found.items())
    ]


def _clock(one: Offset | None) -> dict[str, object]:
    """Return the columns of one measurement; nothing is known of a clock that did not answer."""
    return {
        "measured_utc": _utc(one.measured) if one else None,
        "offset_ms": 1000 * one.offset_s if one else None,
        "error_ms": 1000 * one.error_s if one else None,
        "rtt_ms": 1000 * one.rtt_s if one else None,
        "samples": one.samples if one else 0,
    }


def _duration(seen: Seen, start: float) -> float:
    """Return how long a trial took: to what the engines say ended it, or to when we saw that it was over."""
    begin = max(start, seen.began) if seen.ready_s and seen.began > start + seen.ready_s / 2 else start
    moments = [
        _here(seen, name, seen.matched.get(name) or seen.readings[name].finished)
        for name in seen.end.by
        if name in seen.matched or (name in seen.readings and seen.readings[name].finished)
    ]
    if seen.end.status in ("ok", "crashed") and moments:
        return max(0.0, max(moments) - begin)
    return seen.duration_s


def _here(seen: Seen, service: str, moment: float) -> float:
    """Return a robot's time by the controller's clock."""
    offset = _offset(seen, service)
    return moment - offset.offset_s if offset else moment


def _offset(seen: Seen, service: str) -> Offset | None:
    return seen.before.get(seen.robots.get(service, ""))


def _error(seen: Seen, service: str) -> float:
    offset = _offset(seen, service)
    return offset.error_s if offset else 0.0


def _steps(seen: Seen) -> list[bool]:
    elapsed = seen.ready_s + seen.duration_s + seen.stop_s
    pairs = [(one, seen.after.get(robot)) for robot, one in seen.before.items()]
    return [stepped(one, other, elapsed) for one, other in pairs if one and other]


def _utc(moment: float) -> str | None:
    """Return a time as text; None for one that no calendar has, which a robot may claim."""
    if not 0 <= moment < _LAST_MOMENT:
        return None
    return dt.datetime.fromtimestamp(moment, dt.timezone.utc).isoformat(timespec="milliseconds")
