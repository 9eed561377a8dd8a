"""Single steps, as they are before they are put in order: number 0, and no needs yet. Pure."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from msgspec.structs import replace

from srprov.modules import MODULES, RANK
from srprov.planning.brought import brought
from srprov.planning.plan import Step
from srprov.resource import Action, Change, Condition, Need, Observed, Resource

Key = tuple[str, int, int, str]
There = Mapping[tuple[str, str, str], Observed]
"""Robot, kind and name -> what was found."""


def informed(resource: Resource, there: Mapping[str, Collection[Observed]]) -> Resource:
    """Return a wanted resource with what only robots can say of it; `there` is what was found on them."""
    module = MODULES[resource.module]
    params = module.informed(resource.name, resource.host, resource.params, there)
    return resource if params is resource.params else replace(resource, params=params)


def waits(want: Resource | None, wanted: Mapping[str, Resource]) -> tuple[Need, ...]:
    """Return the needs that take time; or a look, since what is on a robot out of reach is not among the wanted."""
    slow = (Condition.HEALTHY.value, Condition.COMPLETED.value)
    return tuple(
        sorted(
            need
            for need in (want.needs if want else ())
            if need.condition in slow or (need.condition == Condition.STARTED.value and need.id not in wanted)
        )
    )


def due_step(resource: Resource, item: Observed | None) -> Step | None:
    """Return the step that makes a resource right; None when it is right already."""
    change = MODULES[resource.module].check(resource.name, resource.params, item.state if item else None)
    return step_of(resource, change) if change else None


def step_of(resource: Resource, change: Change) -> Step:
    """Return the step of a change."""
    return Step(
        number=0, host=resource.host, module=resource.module, name=resource.name, change=change, want=resource,
        makes=brought(resource, change),
    )  # fmt: skip


def new_step(resource: Resource, cause: str, before: Observed | None = None) -> Step:
    """Return the step that makes a resource, or runs a command, whatever was found."""
    change = MODULES[resource.module].check(resource.name, resource.params, None)
    assert change is not None  # what is not there is never right
    return step_of(resource, replace(change, cause=cause, before=before.state if before else None))


def removal_step(host: str, item: Observed, cause: str, *, destructive: bool = False) -> Step:
    """Return the step that takes away what was found."""
    commands = MODULES[item.module].removal(item)
    change = Change(action=Action.DELETE, cause=cause, destructive=destructive, before=item.state, commands=commands)
    return Step(number=0, host=host, module=item.module, name=item.name, change=change, found=item)


def order_key(step: Step) -> Key:
    """Return the place in the order, and identity: at most one removal and one other step per resource."""
    removes = step.change.action is Action.DELETE
    rank = len(RANK) - RANK[step.module] if removes else RANK[step.module]
    return (step.host, 0 if removes else 1, rank, step.name)
