"""What a change of an EDF would change, from stored facts: two plans of empty robots, compared without a robot.

The second one begins where the first one ended: services stay where they are and keep their addresses, if they can.
Nothing in it can be done: its steps have no commands.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from msgspec.structs import replace

from srprov.controller.old_values import between
from srprov.controller.plan import Planned, make_plan
from srprov.controller.request import PlanRequest
from srprov.controller.robot_files import is_record_path
from srprov.definitions.model import Definitions, Inventory
from srprov.facts.model import Snapshot
from srprov.facts.placements import read_placements
from srprov.facts.stored_look import StoredLook
from srprov.modules import MODULES, RANK, RUNNING
from srprov.modules.file import FileParams
from srprov.modules.tree import TreeParams
from srprov.planning.plan import Plan, Step
from srprov.planning.steps import step_of
from srprov.resource import Action, Change, Difference, Observed, Resource


def compared(
    old: Definitions, new: Definitions, inventory: Inventory, snapshot: Snapshot, request: PlanRequest
) -> Plan:  # fmt: skip
    """Return what would change on robots where `old` is true, to make `new` true; steps without commands.

    Raises:
        As `make_plan`: for one of the two there is no plan on these robots.
    """
    asked = replace(request, adopt=True)
    before = make_plan(old, StoredLook(inventory, snapshot), asked, None)
    there = replace(snapshot, records=_records(before))
    # from one file: where it lies is no difference
    same_place = replace(new.experiment, file=old.experiment.file)
    after = make_plan(replace(new, experiment=same_place), StoredLook(inventory, there), asked, None)
    steps = tuple(_steps(before.desired, after.desired))
    numbered = tuple(replace(step, number=number) for number, step in enumerate(steps, 1))
    changed = {step.id for step in steps if step.want}
    unchanged = sum(one.id not in changed for one in after.desired)
    return replace(after.plan, steps=numbered, unchanged=unchanged)


def _records(before: Planned) -> dict[str, dict[str, Mapping[str, object]]]:
    """Return robot -> the placement records that it would hold."""
    return {
        one.host: read_placements([one.params.text])
        for one in before.desired
        if isinstance(one.params, FileParams) and is_record_path(one.name)
    }


def _steps(old: Iterable[Resource], new: Iterable[Resource]) -> Iterator[Step]:
    """Return the steps, robot by robot, in the order in which a robot is built up."""
    before, after = ({one.id: one for one in side} for side in (old, new))
    blobs = {
        one.name: one.params.blob for one in (*before.values(), *after.values()) if isinstance(one.params, TreeParams)
    }
    runs = {(one.module, one.name): one for one in before.values() if one.module in RUNNING}
    every = {**before, **after}
    for key in sorted(every, key=lambda key: (every[key].host, RANK[every[key].module], every[key].name)):
        if key not in after:
            yield from _gone(before[key], after.values())
        elif key in before:
            yield from _changed(before[key], after[key], blobs)
        else:
            moved = runs.get((after[key].module, after[key].name))
            differences = between(moved, after[key], blobs) if moved else ()
            cause = f"moved from {moved.host}" if moved else "new"
            yield _step(after[key], Change(action=Action.CREATE, cause=cause), differences)


def _gone(one: Resource, after: Iterable[Resource]) -> Iterator[Step]:
    """Return the removal of what is wanted no more; what others may use, and what holds data, stays."""
    module = MODULES[one.module]
    if module.shared or module.holds_data:
        return
    home = next((other.host for other in after if one.service and other.service == one.service), "")
    cause = f"moved to {home}" if home else "no longer needed"
    found = Observed(module=one.module, name=one.name, instance="", state={"service": one.service})
    change = Change(action=Action.DELETE, cause=cause)
    yield Step(number=0, host=one.host, module=one.module, name=one.name, change=change, found=found)


def _changed(old: Resource, new: Resource, blobs: Mapping[str, bytes]) -> Iterator[Step]:
    differences = between(old, new, blobs)
    plain = new.module not in RUNNING and old.params != new.params
    if differences or plain:
        anew = new.module in RUNNING or MODULES[new.module].rebuilds_users
        fields = dict.fromkeys(one.field.partition(".")[0] for one in differences)
        cause = f"{', '.join(fields)} {'differs' if len(fields) == 1 else 'differ'}" if fields else "differs"
        yield _step(new, Change(action=Action.REPLACE if anew else Action.UPDATE, cause=cause), differences)


def _step(want: Resource, change: Change, differences: tuple[Difference, ...]) -> Step:
    return replace(step_of(want, change), differences=differences)
