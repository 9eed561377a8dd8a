"""Compare what should be with what is, and put the differences in order.

Takes desired resources and everything that was found; gives numbered steps. What carries the instance's label and
is not desired is removed, volumes excepted. The order: what a step needs comes first, also across an unchanged
resource in between; a service that moves stops before it starts elsewhere; on each robot containers go before what
they stand on.

Touches nothing. Equal inputs, in any order, give the same steps.
"""

from __future__ import annotations

import dataclasses
import heapq
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from srprov.errors import PlanError
from srprov.modules import PROBING
from srprov.planning.draft import Draft, checked, draft_of, removal_of
from srprov.planning.plan import Step
from srprov.planning.rebuild import rebuild_on_lost_networks, rebuild_on_replaced_networks
from srprov.resource import Action, Change, Condition, Need, Observed, Resource, resource_id

Snapshot = Mapping[str, Sequence[Observed]]
"""Robot -> everything of ours there, of every instance."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Removal:
    """What a removal may take: volumes only when the user says so."""

    volumes: bool = False


def diff(desired: Iterable[Resource], snapshot: Snapshot, instance: str) -> tuple[tuple[Step, ...], int]:
    """Return the steps that make `desired` true, and the number of resources that are right already.

    Raises:
        PlanError: Two resources with one id, or needs that form a circle.
    """
    wanted = _by_id(desired)
    drafts: list[Draft] = []
    unchanged = 0
    there = {(host, item.module, item.name): item for host, items in snapshot.items() for item in items}
    for resource in wanted.values():
        item = there.get((resource.host, resource.module, resource.name))
        change = checked(resource, item)
        if change is None:
            unchanged += 1
        else:
            drafts.append(draft_of(resource, change))
    orphans = _orphans(wanted, snapshot, instance)
    drafts, taken = rebuild_on_replaced_networks(drafts, orphans, wanted, there)
    unchanged -= taken
    drafts = rebuild_on_lost_networks(drafts, there) + orphans
    drafts += (again := _asked_again(drafts, wanted, there))
    return _in_order(drafts, wanted), unchanged - len(again)


def _asked_again(
    drafts: Sequence[Draft], wanted: Mapping[str, Resource], there: Mapping[tuple[str, str, str], Observed]
) -> list[Draft]:
    """Return steps for commands whose check holds now, but which need something that this plan changes.

    The check is asked again right before the command; without the step, the next plan would find it to be due.
    """
    changing = {draft.id: draft for draft in drafts}
    again = []
    solid = {key: dataclasses.replace(one, needs=_without_order(one.needs)) for key, one in wanted.items()}
    for resource in wanted.values():
        if resource.module not in PROBING or resource.id in changing:
            continue
        if reached := sorted(_reached(solid[resource.id].needs, solid, changing)):
            item = there.get((resource.host, resource.module, resource.name))
            cause = f"asked again after {', '.join(reached)}, which it needs"
            change = Change(action=Action.RUN, cause=cause, before=item.state if item else None)
            again.append(draft_of(resource, change))
    return again


def removal_plan(snapshot: Snapshot, instance: str, removal: Removal) -> tuple[Step, ...]:
    """Return the steps that remove all of an instance; volumes only when `removal` says so."""
    drafts = [
        removal_of(host, item, "destroy", destructive=item.module == "volume")
        for host, items in snapshot.items()
        for item in items
        if item.instance == instance and (item.module != "volume" or removal.volumes)
    ]
    return _in_order(drafts, {})


def _without_order(needs: Iterable[Need]) -> tuple[Need, ...]:
    return tuple(need for need in needs if need.condition != Condition.AFTER.value)


def _by_id(desired: Iterable[Resource]) -> dict[str, Resource]:
    wanted: dict[str, Resource] = {}
    for resource in desired:
        if resource.id in wanted:
            raise PlanError(f"{resource.id} stands in {wanted[resource.id].source} and in {resource.source}")
        wanted[resource.id] = resource
    return wanted


def _orphans(wanted: Mapping[str, Resource], snapshot: Snapshot, instance: str) -> list[Draft]:
    homes = {r.params["service"]: r.host for r in wanted.values() if r.module == "container"}
    busy = {r.host for r in wanted.values() if r.module == "container"}
    drafts = []
    for host, items in snapshot.items():
        for item in items:
            ours = item.instance == instance and item.module not in ("volume", "image")
            if ours and resource_id(host, item.module, item.name) not in wanted:
                drafts.append(removal_of(host, item, _orphan_cause(item, homes, host in busy)))
    return drafts


def _orphan_cause(item: Observed, homes: Mapping[str, str], busy: bool) -> str:
    if item.module == "container":
        home = homes.get(str(item.state.get("service")))
        return f"moved to {home}" if home else "no longer in the experiment"
    return "no longer needed" if busy else "no service of the experiment here any more"


def _in_order(drafts: Sequence[Draft], wanted: Mapping[str, Resource]) -> tuple[Step, ...]:
    by_key = {draft.key: draft for draft in drafts}
    if len(by_key) != len(drafts):
        raise PlanError("two steps for one resource")
    needs = {key: _needs(draft, by_key, wanted) for key, draft in by_key.items()}
    numbers: dict[tuple[str, int, int, str], int] = {}
    missing = {key: len(before) for key, before in needs.items()}
    followers: dict[tuple[str, int, int, str], list[tuple[str, int, int, str]]] = {key: [] for key in by_key}
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
            f"these need each other in a circle: {circle}", hint="break the circle in depends_on or the playbook"
        )
    return tuple(_step(by_key[key], numbers, needs[key], wanted) for key in numbers)


def _step(
    draft: Draft,
    numbers: Mapping[tuple[str, int, int, str], int],
    needs: Iterable[tuple[str, int, int, str]],
    wanted: Mapping[str, Resource],
) -> Step:
    key = draft.key
    waits = tuple(sorted(n for n in draft.want.needs if _waited_for(n, wanted))) if draft.want else ()
    return Step(
        number=numbers[key],
        host=draft.host,
        module=draft.module,
        name=draft.name,
        change=draft.change,
        commands=draft.commands,
        needs=tuple(sorted(numbers[one] for one in needs)),
        waits=waits,
        want=draft.want,
        found=draft.found,
    )


def _waited_for(need: Need, wanted: Mapping[str, Resource]) -> bool:
    """Return whether a need takes time; or a look, since what is on a robot out of reach is not among the wanted."""
    away = need.condition == Condition.STARTED.value and need.id not in wanted
    return away or need.condition in (Condition.HEALTHY.value, Condition.COMPLETED.value)


def _needs(
    draft: Draft, by_key: Mapping[tuple[str, int, int, str], Draft], wanted: Mapping[str, Resource]
) -> set[tuple[str, int, int, str]]:
    removals = [d for d in by_key.values() if d.change.action is Action.DELETE and d.key != draft.key]
    if draft.want is None:
        return {d.key for d in removals if d.host == draft.host and _goes_before(d.module, draft.module)}
    changed = {d.id: d.key for d in by_key.values() if d.want is not None}
    needs = {changed[one] for one in _reached(draft.want.needs, wanted, changed)}
    needs |= {d.key for d in removals if d.id == draft.id}
    if draft.module == "container":
        # ports, devices and names must be free first; and a service never runs twice
        service = draft.want.params["service"]
        containers = (d for d in removals if d.module == "container" and d.found is not None)
        needs |= {
            d.key for d in containers if d.host == draft.host or (d.found and d.found.state.get("service") == service)
        }
    if draft.module == "network":
        needs |= {d.key for d in removals if d.host == draft.host and d.module in ("container", "vxlan")}
    return needs


def _goes_before(first: str, second: str) -> bool:
    """Tell which kind is removed first: containers before all, the link before the bridge that it is a port of."""
    return (first == "container" and second != "container") or (first == "vxlan" and second == "network")


def _reached(
    needs: Iterable[Need], wanted: Mapping[str, Resource], changed: Mapping[str, object], seen: set[str] | None = None
) -> set[str]:
    """Return the ids of changing resources that `needs` reach, through unchanged ones."""
    seen = set() if seen is None else seen
    reached = set()
    for need in needs:
        if need.id in seen:
            continue
        seen.add(need.id)
        if need.id in changed:
            reached.add(need.id)
        elif need.id in wanted:
            reached |= _reached(wanted[need.id].needs, wanted, changed, seen)
    return reached
