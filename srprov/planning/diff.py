"""Compare what should be with what is, and put the differences in order.

Takes desired resources and everything that was found; gives numbered steps. What carries the instance's label and
is not desired is removed, volumes excepted. The order: what a step needs comes first, also across an unchanged
resource in between; a service that moves stops before it starts elsewhere; on each robot containers go before what
they stand on.

Touches nothing. Equal inputs, in any order, give the same steps.
"""

from __future__ import annotations

import heapq
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

from srprov.errors import PlanError
from srprov.facts.model import Existing
from srprov.modules import MODULES, RANK
from srprov.planning.plan import Step
from srprov.resource import Action, Change, Condition, Need, Resource, resource_id
from srprov.wire import Command

Found = Mapping[str, Sequence[Existing]]
"""Robot -> everything of ours there, of every instance."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Removal:
    """What a removal may take: volumes only when the user says so."""

    volumes: bool = False


@dataclass(frozen=True, kw_only=True, slots=True)
class _Draft:
    """A step before it has a number."""

    host: str
    module: str
    name: str
    change: Change
    commands: tuple[Command, ...]
    want: Resource | None = None
    found: Existing | None = None

    @property
    def key(self) -> tuple[str, int, int, str]:
        """Place in the order, and identity: at most one removal and one other step per resource."""
        removes = self.change.action is Action.DELETE
        rank = len(RANK) - RANK[self.module] if removes else RANK[self.module]
        return (self.host, 0 if removes else 1, rank, self.name)

    @property
    def id(self) -> str:
        """The resource's address."""
        return resource_id(self.host, self.module, self.name)


def diff(desired: Iterable[Resource], found: Found, instance: str) -> tuple[tuple[Step, ...], int]:
    """Give the steps that make `desired` true, and the number of resources that are right already.

    Raises:
        PlanError: Two resources with one id, or needs that form a circle.
    """
    wanted = _by_id(desired)
    drafts: list[_Draft] = []
    unchanged = 0
    there = {(host, item.module, item.name): item for host, items in found.items() for item in items}
    for resource in wanted.values():
        item = there.get((resource.host, resource.module, resource.name))
        change = MODULES[resource.module].check(resource, item.state if item else None)
        if change is None:
            unchanged += 1
        else:
            drafts.append(_draft(resource, change))
    orphans = _orphans(wanted, found, instance)
    drafts, taken = _rebuild_on_replaced_networks(drafts, orphans, wanted, there)
    unchanged -= taken
    drafts = _rebuild_on_lost_networks(drafts, there) + orphans
    return _in_order(drafts, wanted), unchanged


def removal_plan(found: Found, instance: str, removal: Removal) -> tuple[Step, ...]:
    """Give the steps that remove all of an instance; volumes only when `removal` says so."""
    drafts = [
        _remove(host, item, "destroy", destructive=item.module == "volume")
        for host, items in found.items()
        for item in items
        if item.instance == instance and (item.module != "volume" or removal.volumes)
    ]
    return _in_order(drafts, {})


def _by_id(desired: Iterable[Resource]) -> dict[str, Resource]:
    wanted: dict[str, Resource] = {}
    for resource in desired:
        if resource.id in wanted:
            raise PlanError(f"{resource.id} stands in {wanted[resource.id].source} and in {resource.source}")
        wanted[resource.id] = resource
    return wanted


def _draft(resource: Resource, change: Change) -> _Draft:
    commands = MODULES[resource.module].commands(resource, change)
    return _Draft(
        host=resource.host, module=resource.module, name=resource.name, change=change, commands=commands, want=resource
    )


def _remove(host: str, item: Existing, cause: str, *, destructive: bool = False) -> _Draft:
    change = Change(action=Action.DELETE, cause=cause, destructive=destructive, before=item.state)
    commands = MODULES[item.module].removal(item)
    return _Draft(host=host, module=item.module, name=item.name, change=change, commands=commands, found=item)


def _orphans(wanted: Mapping[str, Resource], found: Found, instance: str) -> list[_Draft]:
    homes = {r.params["service"]: r.host for r in wanted.values() if r.module == "container"}
    busy = {r.host for r in wanted.values() if r.module == "container"}
    drafts = []
    for host, items in found.items():
        for item in items:
            ours = item.instance == instance and item.module not in ("volume", "image")
            if ours and resource_id(host, item.module, item.name) not in wanted:
                drafts.append(_remove(host, item, _orphan_cause(item, homes, host in busy)))
    return drafts


def _orphan_cause(item: Existing, homes: Mapping[str, str], busy: bool) -> str:
    if item.module == "container":
        home = homes.get(str(item.state.get("service")))
        return f"moved to {home}" if home else "no longer in the experiment"
    return "no longer needed" if busy else "no service of the experiment here any more"


def _rebuild_on_replaced_networks(
    drafts: list[_Draft],
    orphans: Sequence[_Draft],
    wanted: Mapping[str, Resource],
    there: Mapping[tuple[str, str, str], Existing],
) -> tuple[list[_Draft], int]:
    """Docker cannot change or remove a network that is in use: what stands on it goes before, and comes back after.

    Returns the drafts, and how many resources that counted as unchanged are now rebuilt.
    """
    replaced = {d.id: d.name for d in drafts if d.module == "network" and d.change.action is Action.REPLACE}
    leaving = {(d.host, d.name) for d in (*drafts, *orphans) if d.module == "network" and d.change.before is not None}
    causes = {draft.id: draft.change.cause for draft in drafts}
    taken = 0
    for resource in wanted.values():
        base = next((replaced[need.id] for need in resource.needs if need.id in replaced), None)
        item = there.get((resource.host, resource.module, resource.name))
        if item is None:
            continue
        if base is not None:
            cause = f"network {base} is replaced"
        elif _stands_on(item, resource.host, leaving):
            # it wants another network from now on, and still holds the old one
            cause = causes.get(resource.id, "its network goes")
        else:
            continue
        before = len(drafts)
        drafts = [d for d in drafts if d.id != resource.id]
        taken += before == len(drafts)
        drafts += [_remove(resource.host, item, cause), _draft(resource, Change(action=Action.CREATE, cause=cause))]
    return drafts, taken


def _stands_on(item: Existing, host: str, networks: Collection[tuple[str, str]]) -> bool:
    """Tell whether a container that was found is attached to one of some robots' networks."""
    attached = item.state["addresses"] if item.module == "container" else ()
    return any((host, name) in networks for name in attached)


def _rebuild_on_lost_networks(drafts: Iterable[_Draft], there: Mapping[tuple[str, str, str], Existing]) -> list[_Draft]:
    """Docker starts a stopped container on the very network that it was made on; without that it never starts again."""
    rebuilt: list[_Draft] = []
    for draft in drafts:
        item = there.get((draft.host, draft.module, draft.name))
        starts = draft.module == "container" and draft.change.action is Action.UPDATE
        if draft.want is None or item is None or not starts or not _lost(draft.want, item, there):
            rebuilt.append(draft)
            continue
        cause = f"{draft.change.cause}; its network was removed"
        rebuilt += [_remove(draft.host, item, cause), _draft(draft.want, Change(action=Action.CREATE, cause=cause))]
    return rebuilt


def _lost(want: Resource, item: Existing, there: Mapping[tuple[str, str, str], Existing]) -> bool:
    """Tell whether a container's end is on another network than the one that has its network's name now, or on none."""
    if want.params["network"]["mode"] != "overlay":
        return False
    name = want.params["network"]["name"]
    network = there.get((want.host, "network", name))
    holds = item.state["network_ids"].get(name)
    # one that was never started has no id yet: Docker looks its network up by name
    return holds is None or (holds != "" and (network is None or holds != network.state["id"]))


def _in_order(drafts: Sequence[_Draft], wanted: Mapping[str, Resource]) -> tuple[Step, ...]:
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
    draft: _Draft,
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
    """Tell whether a need takes time; or a look, since what is on a robot out of reach is not among the wanted."""
    away = need.condition == Condition.STARTED.value and need.id not in wanted
    return away or need.condition in (Condition.HEALTHY.value, Condition.COMPLETED.value)


def _needs(
    draft: _Draft, by_key: Mapping[tuple[str, int, int, str], _Draft], wanted: Mapping[str, Resource]
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
    """Give the ids of changing resources that `needs` reach, through unchanged ones."""
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
