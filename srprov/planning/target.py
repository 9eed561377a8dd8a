"""Keep the steps of some services, and what these need; leave the others as they are. Pure.

What they need: the services that they depend on, images, volumes and the like, and that robots which run others of the
experiment know where these are. A service that is running is never moved, removed or made anew for another one's sake:
where that would be so, the plan is refused.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence

from msgspec.structs import replace

from srprov.codes import Code
from srprov.errors import RefusedError
from srprov.modules import MODULES, RUNNING
from srprov.names import few
from srprov.planning.plan import Plan, Step
from srprov.resource import Action, Condition, Resource

_NAMED = 6
"""Services that a note names."""


def targeted(plan: Plan, wanted: Iterable[Resource], services: Collection[str]) -> Plan:
    """Return the plan with the steps of `services` and those that they need. Steps keep their numbers.

    Args:
        plan: The whole plan.
        wanted: All that should be true; each instance is a service of its own.
        services: The chosen ones; also such as are removed.

    Raises:
        RefusedError: It would take other services from where they run, or cut them off.
    """
    by_id = {one.id: one for one in wanted}
    mine = _needed(by_id, services)
    names = {*services, *(by_id[key].service for key in mine)} - {""}
    _refuse_moves(plan, by_id, names)
    steps = {step.number: step for step in plan.steps}
    core = [step for step in plan.steps if step.service in names or (step.want is not None and step.id in mine)]
    kept = _with_needs(steps, core)
    hosts = _busy(plan, by_id, names)
    for step in plan.steps:
        if step.want is None or step.service or not MODULES[step.module].common or step.host not in hosts:
            continue
        more = _with_needs(steps, [step])
        if any(need.condition == Condition.AFTER.value for need in step.want.needs) and _others(more, steps, names):
            continue  # a user's playbook has it after all that is on the robot
        kept |= more
    if others := _others(kept, steps, names):
        raise RefusedError(
            f"--target would also touch {', '.join(others)}: {_why(kept, steps, others)}",
            hint=f"apply all, or name them too: {' '.join(f'--target {name}' for name in others)}",
            code=Code.OPTIONS,
        )
    return _only(plan, kept, names)


def _needed(by_id: Mapping[str, Resource], services: Collection[str]) -> set[str]:
    """Return the ids of what runs the services, and of all that this needs, other services among it."""
    left = [one.id for one in by_id.values() if one.service in services]
    seen: set[str] = set()
    while left:
        key = left.pop()
        if key not in seen and key in by_id:
            seen.add(key)
            left += [need.id for need in by_id[key].needs if need.condition != Condition.AFTER.value]
    return seen


def _refuse_moves(plan: Plan, by_id: Mapping[str, Resource], names: Collection[str]) -> None:
    """Refuse where another service goes elsewhere or is not wanted any more: robots would forget where it is."""
    made = {step.service: step.host for step in plan.steps if step.want and step.change.action is Action.CREATE}
    homes = {one.service: one.host for one in by_id.values() if one.service}
    moving = {}
    for step in plan.steps:
        name, home = step.service, homes.get(step.service, "")
        if step.want is not None or step.module not in RUNNING or not name or name in names or home == step.host:
            continue
        if not home:
            moving[name] = f"{name} is not in the experiment any more, and is on {step.host}"
        elif name in made:
            moving[name] = f"{name} is to go from {step.host} to {home}"
    if moving:
        raise RefusedError(
            "--target leaves other services as they are, which cannot be: " + "; ".join(moving.values()),
            hint=f"apply all, or name them too: {' '.join(f'--target {name}' for name in sorted(moving))}",
            code=Code.OPTIONS,
        )


def _with_needs(steps: Mapping[int, Step], some: Sequence[Step]) -> set[int]:
    """Return the numbers of steps and of all that must be done before them."""
    kept: set[int] = set()
    left = [step.number for step in some]
    while left:
        number = left.pop()
        if number not in kept:
            kept.add(number)
            left += steps[number].needs
    return kept


def _busy(plan: Plan, by_id: Mapping[str, Resource], names: Collection[str]) -> set[str]:
    """Return the robots with one of the services, or that run another one already; and those with nothing to run."""
    gone = {step.id for step in plan.steps if step.want is None}  # what is made anew was there
    new = {step.id for step in plan.steps if step.want and step.change.action is Action.CREATE} - gone
    running = [one for one in by_id.values() if one.service]
    busy = {one.host for one in running if one.service in names or one.id not in new}
    return busy | ({one.host for one in by_id.values()} - {one.host for one in running})  # they keep the record


def _others(kept: Collection[int], steps: Mapping[int, Step], names: Collection[str]) -> list[str]:
    return sorted({steps[number].service for number in kept} - {"", *names})


def _why(kept: Collection[int], steps: Mapping[int, Step], others: Sequence[str]) -> str:
    first = next(steps[number] for number in sorted(kept) if steps[number].service == others[0])
    return f"{first.id}: {first.change.cause}"


def _only(plan: Plan, kept: Collection[int], names: Collection[str]) -> Plan:
    left = [step for step in plan.steps if step.number not in kept]
    if not left:
        return plan
    others = sorted({step.service for step in left} - {""})
    told = few(others, _NAMED)
    what = f"{told} {'stays as it is' if len(others) == 1 else 'stay as they are'}" if others else "no service waits"
    note = f"{len(left)} steps are left out by --target: {what}"
    return replace(plan, steps=tuple(step for step in plan.steps if step.number in kept), notes=(*plan.notes, note))
