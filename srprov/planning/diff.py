"""Compare what should be with what is, and put the differences in order.

Takes desired resources and everything that was found; gives numbered steps. What carries the instance's label and
is not desired is removed, volumes excepted. The order: what a step needs comes first, also across an unchanged
resource in between; a service that moves stops before it starts elsewhere; on each robot containers go before what
they stand on.

Touches nothing. Equal inputs, in any order, give the same steps.
"""

from __future__ import annotations

import heapq
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

from msgspec.structs import replace

from srprov.codes import Code
from srprov.errors import PlanError
from srprov.modules import MODULES, PROBING
from srprov.planning.amiss import amiss
from srprov.planning.before import Before, taken
from srprov.planning.plan import Step
from srprov.planning.reach import Reach
from srprov.planning.rebuild import rebuild_stranded, rebuild_users
from srprov.planning.steps import Key, There, due_step, informed, new_step, order_key, removal_step, waits
from srprov.resource import Condition, Need, Observed, Resource, resource_id

ObservedByRobot = Mapping[str, Sequence[Observed]]
"""Robot -> everything of ours there, of every instance."""


def diff(
    desired: Iterable[Resource],
    observed: ObservedByRobot,
    instance: str,
    *,
    settled: Collection[str] = (),
    beside: Sequence[Step] = (),
) -> tuple[tuple[Step, ...], int]:
    """Return the steps that make `desired` true, and the number of resources that are right; what is `amiss` is not.

    Args:
        desired: What should be true.
        observed: What was found.
        instance: The instance.
        settled: Ids of resources that are not compared: right already, or a step of `beside` is about them.
        beside: Steps of robots that cannot be looked at; they are put in order with the others.

    Raises:
        PlanError: Two resources with one id, or needs that form a circle.
    """
    wanted = {key: informed(one, observed) for key, one in _by_id(desired).items()}
    there = {(host, item.module, item.name): item for host, items in observed.items() for item in items}
    found = {one.id: there.get((one.host, one.module, one.name)) for one in wanted.values() if one.id not in settled}
    left = {key for key, item in found.items() if amiss(wanted[key], item)}
    due = [due_step(wanted[key], item) for key, item in found.items() if key not in left]
    steps = [step for step in due if step is not None]
    copying = {step.id for step in (*steps, *beside) if step.want}
    orphans = _orphans(wanted, there, observed, instance, copying)
    rebuilt = rebuild_users(steps, orphans, wanted, there)
    changing = [*rebuild_stranded(rebuilt, there), *orphans, *beside]
    again = _asked_again(changing, wanted, there)
    touched = {step.id for step in (*changing, *again) if step.want}
    return _in_order([*changing, *again], wanted), len(wanted.keys() - touched - left)


def _asked_again(steps: Sequence[Step], wanted: Mapping[str, Resource], there: There) -> list[Step]:
    """Return steps for commands whose check holds now, but which need something that this plan changes.

    The check is asked again right before the command; without the step, the next plan would find it to be due.
    """
    changing = {step.id: step for step in steps}
    again = []
    solid = {key: replace(one, needs=_without_order(one.needs)) for key, one in wanted.items()}
    reach = Reach(solid, changing)
    for resource in wanted.values():
        if resource.module not in PROBING or resource.id in changing:
            continue
        if reached := sorted(reach.of(solid[resource.id].needs)):
            cause = f"asked again after {', '.join(reached)}, which it needs"
            again.append(new_step(resource, cause, there.get((resource.host, resource.module, resource.name))))
    return again


def removal_plan(observed: ObservedByRobot, instance: str, *, volumes: bool) -> tuple[Step, ...]:
    """Return the steps that remove all of an instance; what holds data only with `volumes`."""
    mine = [(host, item, MODULES[item.module].keeps(item.state)) for host, item in _owned(observed, instance)]
    steps = [
        removal_step(host, item, "destroy", destructive=keeps) for host, item, keeps in mine if volumes or not keeps
    ]
    return _in_order(steps, {})


def _owned(observed: ObservedByRobot, instance: str) -> Iterator[tuple[str, Observed]]:
    """Return what is an instance's own, robot by robot."""
    for host, items in observed.items():
        for item in items:
            if item.instance == instance and not MODULES[item.module].shared:
                yield host, item


def _without_order(needs: Iterable[Need]) -> tuple[Need, ...]:
    return tuple(need for need in needs if need.condition != Condition.AFTER.value)


def _by_id(desired: Iterable[Resource]) -> dict[str, Resource]:
    wanted: dict[str, Resource] = {}
    for resource in desired:
        if resource.id in wanted:
            message = f"{resource.id} stands in {wanted[resource.id].source} and in {resource.source}"
            raise PlanError(message, code=Code.TWICE)
        wanted[resource.id] = resource
    return wanted


def _orphans(
    wanted: Mapping[str, Resource], there: There, observed: ObservedByRobot, instance: str, copying: Collection[str]
) -> list[Step]:
    homes = {one.service: one.host for one in wanted.values() if one.service}
    busy = frozenset(homes.values())
    copied = {
        source: one.host
        for source, one in taken(wanted).items()
        if one.id in copying or _is_copied(one, there.get((one.host, one.module, one.name)))
    }
    return [
        removal_step(host, item, _orphan_cause(item, homes, host in busy, copied.get(id_, "")))
        for host, item in _owned(observed, instance)
        if (id_ := resource_id(host, item.module, item.name)) in copied
        or (id_ not in wanted and not MODULES[item.module].keeps(item.state))
    ]


def _is_copied(heir: Resource, item: Observed | None) -> bool:
    """Return whether an earlier plan copied: what is there for another reason replaces nothing."""
    return item is not None and MODULES[heir.module].is_copy(heir.params, item.state)


def _orphan_cause(item: Observed, homes: Mapping[str, str], busy: bool, copied: str) -> str:
    if copied:
        return f"copied to {copied}, and compared there"
    if leftover := item.state.get("leftover"):
        return str(leftover)
    if item.service:
        return f"moved to {homes[item.service]}" if item.service in homes else "no longer in the experiment"
    return "no longer needed" if busy else "no service of the experiment here any more"


def _in_order(steps: Sequence[Step], wanted: Mapping[str, Resource]) -> tuple[Step, ...]:
    by_key = {order_key(step): step for step in steps}
    if len(by_key) != len(steps):
        raise PlanError("two steps for one resource", code=Code.TWICE)
    order = Before(by_key, wanted)
    needs = {key: order.of(step) for key, step in by_key.items()}
    numbers: dict[Key, int] = {}
    missing = {key: len(before) for key, before in needs.items()}
    followers: dict[Key, list[Key]] = {key: [] for key in by_key}
    for key, before in needs.items():
        for one in before:
            followers[one].append(key)
    ready = [key for key, count in missing.items() if count == 0]
    heapq.heapify(ready)
    while ready:
        key = heapq.heappop(ready)
        numbers[key] = len(numbers) + 1
        for follower in followers[key]:
            missing[follower] -= 1
            if missing[follower] == 0:
                heapq.heappush(ready, follower)
    if len(numbers) != len(by_key):
        circle = ", ".join(sorted(by_key[key].id for key in by_key if key not in numbers))
        raise PlanError(
            f"these need each other in a circle: {circle}",
            hint="break the circle in depends_on or the playbook",
            code=Code.DEPENDENCY,
        )
    return tuple(
        replace(
            by_key[key],
            number=number,
            needs=tuple(sorted(numbers[one] for one in needs[key])),
            waits=waits(by_key[key].want, wanted),
        )
        for key, number in numbers.items()
    )
