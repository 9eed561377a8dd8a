"""One attempt at a trial, and how it ended and what it gave -> its row."""

from __future__ import annotations

from pathlib import Path

import msgspec

from srprov.controller.trial_files import Gathered
from srprov.controller.trial_plan import TrialPlan
from srprov.execution.trial import TrialEnd
from srprov.execution.trial_robots import TrialRobots
from srprov.trials import Trial
from srprov.trials.judge import COUNTED, End, verdict
from srprov.trials.row import Seen, row

Row = dict[str, object]


class Attempt(msgspec.Struct, frozen=True, kw_only=True):
    """One attempt at a trial."""

    plan: TrialPlan
    trial: Trial
    number: int
    """Counted from 1."""
    segment: int
    """Of the run: one more after each time that changes were accepted."""
    order: int
    """The trial's place in the design, counted from 1."""
    robots: TrialRobots
    folder: Path
    """Where all that it gives is kept."""


def outcome(one: Attempt, ended: TrialEnd, gathered: Gathered) -> Row:
    """Return the row of an attempt that ended and whose data are at home."""
    end = ended.end
    if gathered.missing and end.status == "ok":  # who crashed could not write it, and that is data
        end = End("infrastructure", f"a required result is missing: {', '.join(gathered.missing)}")
    judged = verdict(one.plan.given.settings.success, ended.readings, gathered.matched, gathered.metrics)
    return {
        **unjudged(one, ended, gathered, end),
        "verdict": judged if end.status in COUNTED else "unknown",
        **{f"m_{name}": value for name, value in gathered.metrics.items()},
        "files": gathered.files,
        "bytes": gathered.bytes,
        "unclosed": gathered.unclosed,
    }


def unjudged(one: Attempt, ended: TrialEnd, gathered: Gathered, end: End) -> Row:
    """Return the row of an attempt as far as it follows from readings."""
    moments: dict[str, float] = {}
    for (service, _), when in gathered.first.items():
        moments[service] = min(when, moments.get(service, when))
    seen = Seen(
        end=end,
        readings=ended.readings,
        robots={service.service: service.host for service in one.plan.services},
        before=ended.before,
        after=ended.after,
        began=ended.began,
        ready_s=ended.ready_s,
        duration_s=ended.duration_s,
        stop_s=ended.stop_s,
        matched=moments,
    )
    return {**row(one.trial, one.number, one.order, seen), "segment": one.segment}
