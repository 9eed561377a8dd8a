"""Leave out the steps of robots that the user did not choose. Pure.

It filters what is changed, never what is decided.
"""

from __future__ import annotations

from collections.abc import Collection

from msgspec.structs import replace

from srprov.planning.plan import Plan


def limited(plan: Plan, hosts: Collection[str]) -> Plan:
    """Return the plan with only the steps on `hosts`, and without those that need a step that is left out.

    Steps keep their numbers, so that they can be compared with the whole plan.
    """
    kept: dict[int, bool] = {}
    for step in plan.steps:
        kept[step.number] = step.host in hosts and all(kept[number] for number in step.needs)
    steps = tuple(step for step in plan.steps if kept[step.number])
    if len(steps) == len(plan.steps):
        return plan
    needy = sum(step.host in hosts and not kept[step.number] for step in plan.steps)
    notes = [f"{len(plan.steps) - len(steps)} steps are left out by --limit or --exclude"]
    if needy:
        notes.append(f"{needy} of them stand on chosen robots but need steps on others")
    return replace(plan, steps=steps, notes=(*plan.notes, *notes))
