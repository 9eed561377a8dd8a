"""When a trial has ended, and what came of it.

| status | means | counts | tried again |
|---|---|---|---|
| `ok` | it ended as `until` says, in time | yes | no |
| `timeout` | it was stopped when its time was over | yes | no |
| `crashed` | a service failed before `until` was reached | yes | no |
| `infrastructure` | the equipment failed: a robot, an engine, a service that never got ready, a result | no | yes |
| `interrupted` | the run ended before the trial did | no | yes |

The status says whether the apparatus worked, the verdict whether the robots did what they should. Pure.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

import msgspec

from srprov.definitions.trialsmodel import Condition, Conditions, TrialSettings
from srprov.trials.reading import Reading

COUNTED = ("ok", "timeout", "crashed")
"""Statuses of trials that count in an analysis."""
Match = tuple[str, str]
"""A service, and a pattern that some line of its log matched."""


class End(msgspec.Struct, frozen=True):
    """How a trial ended."""

    status: str
    reason: str
    by: tuple[str, ...] = ()
    """The services whose state or log ended it, in name order."""


def ended(
    settings: TrialSettings, jobs: Collection[str], readings: Mapping[str, Reading], matched: Collection[Match],
    elapsed_s: float,
) -> End | None:  # fmt: skip
    """Return how a trial has ended, or None while it goes on.

    Args:
        settings: Of its trials.
        jobs: Services that are part of each trial and have no `restart`.
        readings: Service -> its container.
        matched: What logs have matched so far.
        elapsed_s: Since the trial began.
    """
    if met := _met(settings.until, jobs, readings, matched, elapsed_s):
        return met
    failed = (name for name in sorted(jobs) if readings[name].ended and readings[name].exit_code)
    if name := next((name for name in failed if not _awaited(settings.until, name, readings[name].exit_code)), ""):
        why = " (out of memory)" if readings[name].oom else ""
        return End("crashed", f"{name} exited with {readings[name].exit_code}{why}", (name,))
    if elapsed_s >= settings.timeout_s:
        return End("timeout", f"not over after {settings.timeout_s:g} s{_unended(settings.until, jobs, readings)}")
    if settings.until is not None and jobs and all(readings[name].ended for name in jobs):
        needs_time = any(one.kind == "after" for one in settings.until.items)
        if not needs_time and len(jobs) == len(readings):
            return End("crashed", "all services ended, and 'until' was not reached", tuple(sorted(jobs)))
    return None


def _met(
    until: Conditions | None, jobs: Collection[str], readings: Mapping[str, Reading], matched: Collection[Match],
    elapsed_s: float,
) -> End | None:  # fmt: skip
    if until is None:
        done = bool(jobs) and all(readings[name].ended and not readings[name].exit_code for name in jobs)
        return End("ok", "all services ended", tuple(sorted(jobs))) if done else None
    true = [one for one in until.items if holds(one, readings, matched, elapsed_s=elapsed_s)]
    if len(true) == len(until.items) if until.every else true:
        shown = true if until.every else true[:1]
        by = sorted({name for one in shown for name in one.services})
        return End("ok", " and ".join(in_words(one) for one in shown), tuple(by))
    return None


def _unended(until: Conditions | None, jobs: Collection[str], readings: Mapping[str, Reading]) -> str:
    """Return who keeps a trial from its end where `until` does not say when it is over; else nothing."""
    running = ", ".join(name for name in sorted(jobs) if not readings[name].ended)
    return f": without `until` it waits for {running} to end" if until is None and running else ""


def _awaited(until: Conditions | None, name: str, code: int) -> bool:
    """Return whether `until` asks for the end of a service with this exit code."""
    items = until.items if until is not None else ()
    return any(
        name in one.services and (one.kind == "completed" or (one.kind == "exit" and one.code == code)) for one in items
    )


def holds(
    one: Condition, readings: Mapping[str, Reading], matched: Collection[Match],
    metrics: Mapping[str, float] | None = None, elapsed_s: float = 0.0,
) -> bool:  # fmt: skip
    """Return whether a condition holds."""
    some = [readings[name] for name in one.services if name in readings]
    if len(some) < len(one.services):
        return False
    if one.kind == "completed":
        return all(reading.ended for reading in some)
    if one.kind == "healthy":
        return all(reading.health == "healthy" for reading in some)
    if one.kind == "exit":
        return all(reading.ended and reading.exit_code == one.code for reading in some)
    if one.kind == "log":
        return any((name, one.pattern) in matched for name in one.services)
    if one.kind == "after":
        return elapsed_s >= one.seconds
    value = (metrics or {}).get(one.metric)
    if value is None:
        return False
    return (
        (one.below is None or value < one.below)
        and (one.above is None or value > one.above)
        and (one.equals is None or value == one.equals)
    )


def verdict(
    success: Conditions | None, readings: Mapping[str, Reading], matched: Collection[Match],
    metrics: Mapping[str, float],
) -> str:  # fmt: skip
    """Return `success`, `failure`, or `unknown` where nobody said what success is."""
    if success is None:
        return "unknown"
    true = [holds(one, readings, matched, metrics) for one in success.items]
    return "success" if (all(true) if success.every else any(true)) else "failure"


def in_words(one: Condition) -> str:
    """Return a condition in words."""
    who = ", ".join(one.services)
    if one.kind == "exit":
        return f"{who} exited with {one.code}"
    if one.kind == "log":
        return f"{who} printed {one.pattern}"
    if one.kind == "after":
        return f"{one.seconds:g} s are over"
    if one.kind == "metric":
        bounds = (("below", one.below), ("above", one.above), ("equal to", one.equals))
        return f"{one.metric} is {' and '.join(f'{word} {limit:g}' for word, limit in bounds if limit is not None)}"
    return f"{who} {one.kind}"
