"""From moments of trials to steps, medians and tables. Pure."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from typing import Any

STEPS = ("create", "start", "wait", "stop", "collect", "remove")
Moments = Mapping[str, float]
"""Step -> when it ended, in seconds of one clock; `begin` is when the trial began."""


def overheads(trials: Sequence[Moments], service_s: float) -> list[dict[str, float]]:
    """Return what each trial took beside the service's own time, by step, and as `all`.

    Args:
        trials: One after the other.
        service_s: How long the service runs; taken off the step `wait`. A service that was started early has run for
            some time when all are started, so what is left of `wait` may be negative.

    Returns:
        Seconds. `between` is from a trial's end to the beginning of the next one; the last trial has none.
    """
    found = []
    for trial, following in zip(trials, [*trials[1:], None], strict=True):
        one, last = {}, trial["begin"]
        for step in STEPS:
            if step in trial:
                one[step] = trial[step] - last - (service_s if step == "wait" else 0)
                last = trial[step]
        if following is not None:
            one["between"] = following["begin"] - last
        found.append({**one, "all": sum(one.values())})
    return found


def summary(found: Sequence[Mapping[str, float]]) -> dict[str, dict[str, float]]:
    """Return step -> median and p95 in seconds, of trials that have that step."""
    names = [name for name in (*STEPS, "between", "all") if any(name in one for one in found)]
    return {name: _spread([one[name] for one in found if name in one]) for name in names}


def _spread(values: Sequence[float]) -> dict[str, float]:
    """Return the median, and the least value that 95 % are not above."""
    return {"median": statistics.median(values), "p95": sorted(values)[math.ceil(0.95 * len(values)) - 1]}


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return a Markdown table: a row for each way, with ms by step, as median and p95."""
    names = [name for name in (*STEPS, "between") if any(name in row["steps"] for row in rows)]
    lines = [
        "| ms beside the service's own time: median (p95) | whole | " + " | ".join(names) + " | trials |",
        "|---" * (len(names) + 3) + "|",
    ]
    for row in rows:
        cells = [_cell(row["steps"].get(name)) for name in ("all", *names)]
        lines.append("| " + " | ".join([row["tool"], *cells, str(row["trials"])]) + " |")
    return "\n".join(lines) + "\n"


def _cell(spread: Mapping[str, float] | None) -> str:
    return "-" if spread is None else f"{1000 * spread['median']:.0f} ({1000 * spread['p95']:.0f})"
