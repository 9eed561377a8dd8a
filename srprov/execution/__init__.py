"""A plan and sessions -> what came of every step. The only room that changes robots.

`run_plan` walks the plan: robots in parallel, steps of one robot in order, a step after all that it needs. Before
its first act on a robot it reads the robot's part again; after each stretch of steps it reads once more and only
what is right then counts as changed.
"""

from __future__ import annotations

from srprov.execution.executor import Options, run_plan
from srprov.execution.outcome import Event, Listener, Outcome, RunResult, StepResult

__all__ = ["Event", "Listener", "Options", "Outcome", "RunResult", "StepResult", "run_plan"]
