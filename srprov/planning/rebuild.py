"""What else must be made anew: what stands on something that is replaced or gone. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from srprov.modules import MODULES
from srprov.planning.plan import Step
from srprov.planning.steps import There, new_step, removal_step
from srprov.resource import Action, Condition, Observed, Resource, State


def rebuild_users(
    steps: Sequence[Step], orphans: Sequence[Step], wanted: Mapping[str, Resource], there: There
) -> list[Step]:
    """Replace the steps of what uses something that cannot be replaced while it is in use: removed before, made after.

    What counted as unchanged may be rebuilt too.
    """
    bases = [step for step in (*steps, *orphans) if MODULES[step.module].rebuilds_users]
    replaced = {
        step.id: f"{step.module} {step.name} is replaced" for step in bases if step.change.action is Action.REPLACE
    }
    leaving = {(step.host, step.module, step.name): step.module for step in bases if step.change.before is not None}
    by_id = {step.id: step for step in steps}
    rebuilt: dict[str, list[Step]] = {}
    for resource in wanted.values():
        item = there.get((resource.host, resource.module, resource.name))
        if item is None:
            continue
        needs = (need.id for need in resource.needs if need.condition != Condition.AFTER.value)
        cause = next((replaced[one] for one in needs if one in replaced), None)
        stands = MODULES[item.module].stands_on(item.state)
        base = next((leaving[host_key] for key in stands if (host_key := (resource.host, *key)) in leaving), None)
        if cause is None and base is not None:
            # it wants another one from now on, and still holds the old one
            own = by_id.get(resource.id)
            cause = own.change.cause if own else f"its {base} goes"
        if cause is not None:
            rebuilt[resource.id] = _anew(resource, item, cause)
    kept = [step for step in steps if step.id not in rebuilt]
    return [*kept, *(step for pair in rebuilt.values() for step in pair)]


def rebuild_stranded(steps: Iterable[Step], there: There) -> list[Step]:
    """Replace the steps that would start something on what is gone: it must be made anew."""
    rebuilt: list[Step] = []
    by_robot: dict[str, dict[tuple[str, str], State]] = {}
    for (host, kind, name), one in there.items():
        by_robot.setdefault(host, {})[kind, name] = one.state
    for step in steps:
        item = there.get((step.host, step.module, step.name))
        update = step.change.action is Action.UPDATE
        lost = _lost(step.want, item, by_robot[step.host]) if step.want and item and update else ""
        if lost and step.want and item:
            rebuilt += _anew(step.want, item, f"{step.change.cause}; {lost}")
        else:
            rebuilt.append(step)
    return rebuilt


def _lost(want: Resource, item: Observed, others: Mapping[tuple[str, str], State]) -> str:
    return MODULES[want.module].stranded(want.params, item.state, others)


def _anew(want: Resource, item: Observed, cause: str) -> list[Step]:
    return [removal_step(want.host, item, cause), new_step(want, cause)]
