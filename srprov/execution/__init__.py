"""A plan and sessions -> what came of every step. The only room that changes robots.

`run_plan` walks the plan: robots in parallel, steps of one robot in order, a step after all that it needs. Before
its first act on a robot it reads the robot's part again; after each batch of steps it reads once more and only
what is right then counts as changed.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import TYPE_CHECKING

from srprov.execution.options import RunOptions
from srprov.execution.outcome import Event, Listener, Outcome, RunResult, StepResult

if TYPE_CHECKING:
    from srprov.execution.lock_set import LockSet
    from srprov.planning.plan import Plan
    from srprov.session import Session

__all__ = ["Event", "Listener", "Outcome", "RunOptions", "RunResult", "StepResult", "run_plan"]


def run_plan(
    plan: Plan,
    sessions: Mapping[str, Session],
    listener: Listener,
    options: RunOptions | None = None,
    stop: threading.Event | None = None,
    held: LockSet | None = None,
) -> RunResult:
    """Lock the robots that the plan changes, do every step and say what came of each.

    Args:
        plan: what to do.
        sessions: connections to all robots that can be reached.
        listener: told what happens, from several threads at once.
        options: limits and deadlines; None: the defaults.
        stop: set from outside to begin no further step.
        held: the locks, where the caller holds them already, of all robots that the plan changes.

    Raises:
        LockHeld: Somebody else holds one of the robots; nothing was changed.
    """
    options = options or RunOptions()
    stop = stop or threading.Event()
    if not plan.steps:  # nobody is needed, and what walks is not imported
        return RunResult(
            results=(),
            unchanged=plan.unchanged,
            interrupted=stop.is_set(),
            unreachable=plan.unreachable,
            tolerated=options.tolerate,
        )
    from srprov.execution.executor import walk

    return walk(plan, sessions, listener, options, stop, held)
