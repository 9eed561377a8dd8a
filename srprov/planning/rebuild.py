"""What else must be made anew: containers and links on networks that are replaced or gone. Pure."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence

from srprov.planning.draft import Draft, draft_of, removal_of
from srprov.resource import Action, Change, Condition, Observed, Resource


def rebuild_on_replaced_networks(
    drafts: list[Draft],
    orphans: Sequence[Draft],
    wanted: Mapping[str, Resource],
    there: Mapping[tuple[str, str, str], Observed],
) -> tuple[list[Draft], int]:
    """Docker cannot change or remove a network that is in use: what stands on it goes before, and comes back after.

    Returns the drafts, and how many resources that counted as unchanged are now rebuilt.
    """
    replaced = {d.id: d.name for d in drafts if d.module == "network" and d.change.action is Action.REPLACE}
    leaving = {(d.host, d.name) for d in (*drafts, *orphans) if d.module == "network" and d.change.before is not None}
    causes = {draft.id: draft.change.cause for draft in drafts}
    taken = 0
    for resource in wanted.values():
        needs = (need for need in resource.needs if need.condition != Condition.AFTER.value)
        base = next((replaced[need.id] for need in needs if need.id in replaced), None)
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
        drafts += [
            removal_of(resource.host, item, cause),
            draft_of(resource, Change(action=Action.CREATE, cause=cause)),
        ]
    return drafts, taken


def _stands_on(item: Observed, host: str, networks: Collection[tuple[str, str]]) -> bool:
    """Return whether a container that was found is attached to one of some robots' networks."""
    attached = item.state["addresses"] if item.module == "container" else ()
    return any((host, name) in networks for name in attached)


def rebuild_on_lost_networks(drafts: Iterable[Draft], there: Mapping[tuple[str, str, str], Observed]) -> list[Draft]:
    """Docker starts a stopped container on the very network that it was made on; without that it never starts again."""
    rebuilt: list[Draft] = []
    for draft in drafts:
        item = there.get((draft.host, draft.module, draft.name))
        starts = draft.module == "container" and draft.change.action is Action.UPDATE
        if draft.want is None or item is None or not starts or not _lost(draft.want, item, there):
            rebuilt.append(draft)
            continue
        cause = f"{draft.change.cause}; its network was removed"
        rebuilt += [
            removal_of(draft.host, item, cause),
            draft_of(draft.want, Change(action=Action.CREATE, cause=cause)),
        ]
    return rebuilt


def _lost(want: Resource, item: Observed, there: Mapping[tuple[str, str, str], Observed]) -> bool:
    """Return if a container's end is on another network than the one that has its network's name now, or on none."""
    if want.params["network"]["mode"] != "overlay":
        return False
    name = want.params["network"]["name"]
    network = there.get((want.host, "network", name))
    holds = item.state["network_ids"].get(name)
    # one that was never started has no id yet: Docker looks its network up by name
    return holds is None or (holds != "" and (network is None or holds != network.state["id"]))
