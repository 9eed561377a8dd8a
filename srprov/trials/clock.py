"""How far a robot's clock is from the controller's, and how surely that is known. Pure.

The robot is asked for its time several times. Its answer was made somewhere between question and answer, so half of the
round trip is the bound of the error; the sample with the shortest round trip is the best.

Source: RFC 956; RFC 5905, "Clock filter algorithm".
"""

from __future__ import annotations

from collections.abc import Iterable

import msgspec

_DRIFT = 500e-6
"""Seconds a second: faster than any clock drifts that has not stepped; what NTP allows too."""


class Sample(msgspec.Struct, frozen=True, kw_only=True):
    """One question, in seconds since the epoch: by the controller's clock but for `robot`."""

    asked: float
    robot: float
    answered: float
    resolution: float = 0.0
    """The step of the robot's answer."""


class Offset(msgspec.Struct, frozen=True, kw_only=True):
    """A robot's clock minus the controller's, in seconds; the truth lies within `error_s` of it."""

    offset_s: float
    error_s: float
    rtt_s: float
    samples: int
    measured: float = 0.0
    """When, by the controller's clock, in seconds since the epoch."""


def offset(samples: Iterable[Sample]) -> Offset | None:
    """Return the offset by the sample with the smallest error; None without any."""
    every = list(samples)
    if not every:
        return None
    best = min(every, key=_error)
    middle = (best.asked + best.answered) / 2
    return Offset(
        # a robot that tells whole steps has cut its time off: it is half a step later on average
        offset_s=best.robot + best.resolution / 2 - middle,
        error_s=_error(best),
        rtt_s=best.answered - best.asked,
        samples=len(every),
        measured=middle,
    )


def _error(one: Sample) -> float:
    return (one.answered - one.asked) / 2 + one.resolution / 2


def stepped(before: Offset, after: Offset, elapsed_s: float) -> bool:
    """Return whether a clock was set in between: its offset moved by more than errors and drift explain."""
    return abs(after.offset_s - before.offset_s) > before.error_s + after.error_s + _DRIFT * elapsed_s
