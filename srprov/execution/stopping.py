"""Containers of one robot that several steps stop, stopped side by side: each may take all of its grace.

Takes steps; gives the script that stops what they begin with stopping. It only saves time: each step stops its own
container again, and says what came of it. Pure.
"""

from __future__ import annotations

from collections.abc import Iterable

from srprov.planning.plan import Step
from srprov.wire import STOP_MARGIN_S, EngineCall, Run, sh


def begins_with_stop(step: Step) -> bool:
    """Return whether a step stops a container before anything else."""
    return _stop(step) is not None


def stop_together(steps: Iterable[Step], most_s: float) -> Run:
    """Return the script that stops what these steps stop, each with its own grace but none with more than `most_s`."""
    return stop_all((call for step in steps if (call := _stop(step))), most_s)


def stop_all(calls: Iterable[EngineCall], most_s: float) -> Run:
    """Return the script that does what these calls of one engine do, which stop a container each, at the same time.

    The docker CLI stops all that it is told at once; it is started for each grace.
    """
    by_grace: dict[str, list[str]] = {}
    for call in calls:
        ((_, grace),) = call.stopping_within(most_s).params
        by_grace.setdefault(grace, []).append(call.path.removeprefix("/containers/").removesuffix("/stop"))
    lines = [sh("docker", "stop", "-t", grace, "--", *names) for grace, names in sorted(by_grace.items())]
    script = "".join(f"{line} >/dev/null 2>&1 </dev/null & " for line in lines) + "wait"
    return Run(script=script, timeout_s=max(map(float, by_grace), default=0.0) + STOP_MARGIN_S)


def _stop(step: Step) -> EngineCall | None:
    first = step.commands[0] if step.commands else None
    return first if isinstance(first, EngineCall) and first.stop_grace_s is not None else None
