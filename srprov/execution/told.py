"""A step with what robots said in the course of its run, such as a public key that another robot made just now.

When the plan was made nobody could know it, so that the plan's commands name it in words. They still have to be those
that follow for the robot; those that are done in their place have the words replaced. Pure.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

from msgspec.structs import replace

from srprov.modules import MODULES
from srprov.modules.module import Module
from srprov.planning.plan import Step
from srprov.planning.steps import informed
from srprov.resource import Observed

Seen = Mapping[tuple[str, str], Observed]
"""Kind and name -> what was last seen of it on a robot."""


def asks_others(step: Step) -> bool:
    """Return whether what is wanted depends on what other robots say."""
    return step.want is not None and type(MODULES[step.module]).informed is not Module.informed


def told(step: Step, seen: Seen, there: Mapping[str, Collection[Observed]]) -> Step:
    """Return a step as it is to be done now; `seen` is of its robot, `there` of all robots of the run.

    One whose commands do not follow for the robot as it is stays as it was: it is stale, and refused as such.
    """
    want = informed(step.want, there) if step.want else None
    if want is None or want is step.want or want == step.want:
        return step
    item = seen.get((step.module, step.name))
    state, check = item.state if item else None, MODULES[step.module].check
    planned, now = (
        check(step.name, step.want.params, state) if step.want else None,
        check(step.name, want.params, state),
    )
    if planned is None or planned.commands != step.commands:
        return step
    commands = now.commands if now else step.commands
    return replace(step, want=want, change=replace(step.change, commands=commands))
