"""What a plan says of an overlay: that a robot's link, or its word, gives it another MTU, or other addresses. Pure.

For another MTU all of its containers are made anew. What a robot reached behind its default route, it does not reach
any more when an overlay comes to it with these addresses: its packets go to whoever takes them there. So whoever reads
the plan is told which, and by whose word.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from ipaddress import IPv4Network

from srprov.definitions.model import Experiment, NetworkSettings
from srprov.facts.model import Snapshot
from srprov.modules.network import NetworkParams
from srprov.names import few
from srprov.network.foreign import foreign_uses, overlap
from srprov.network.identity import identify, link_names
from srprov.network.model import Overlay
from srprov.network.record import read_record
from srprov.planning.plan import Step
from srprov.resource import State

_SHOWN = 4
_LOST = "what is reached there by a default route is reached no more"


def overlay_notes(overlay: Overlay, snapshot: Snapshot, experiment: Experiment) -> tuple[str, ...]:
    """Return what is to be said of an overlay: nothing where it is as its name and its robots' links make it."""
    return (
        *_of_mtu(overlay, snapshot), *_of_subnet(overlay, snapshot, experiment.network), *_of_taken(overlay, snapshot)
    )  # fmt: skip


def _of_taken(overlay: Overlay, snapshot: Snapshot) -> Iterator[str]:
    """Return a note for each robot out of reach of which another one has the address by now: it gets nothing."""
    record = read_record(snapshot.placements.get(overlay.instance))
    now = {facts.underlay_address: robot for robot, facts in sorted(snapshot.facts.items())}
    for robot, vtep in (record.vteps if record else {}).items():
        if robot not in snapshot.facts and vtep in now:
            yield f"{robot} is out of reach, and {now[vtep]} has the address {vtep} that it had: nothing is sent to it"


def _of_mtu(overlay: Overlay, snapshot: Snapshot) -> tuple[str, ...]:
    """Return a note when networks of the overlay that are there have a larger MTU than it gets.

    Docker gives a network its MTU when it makes it, and containers theirs when they join.
    """
    most = max((int(one["mtu"]) for _, one in _networks(overlay, snapshot)), default=0)
    if not overlay.active or most <= overlay.mtu:
        return ()
    members = [(snapshot.facts[robot].underlay_mtu, robot) for robot in overlay.vteps if robot in snapshot.facts]
    carries, robot = min(members, default=(0, ""))
    why = f", as {robot}'s link carries {carries} bytes" if robot and carries < most + 50 else ""
    return (
        f"the overlay's MTU is {most} and becomes {overlay.mtu}{why}: its networks, and the containers on them, "
        "are made anew on all robots; where robots with narrow links may join later, begin with a smaller network.mtu",
    )


def _of_subnet(overlay: Overlay, snapshot: Snapshot, settings: NetworkSettings) -> tuple[str, ...]:
    """Return a note when a robot gets a subnet that neither the EDF nor the instance's name says."""
    if not overlay.active or settings.subnet is not None:
        return ()
    usual = _usual(overlay.instance)
    having = sorted(robot for robot, one in _networks(overlay, snapshot) if one.get("subnet") == overlay.subnet)
    new = sorted((overlay.vteps.keys() & snapshot.facts.keys()) - {*having})
    if overlay.subnet == str(usual) or not new:
        return ()
    if having:
        why = f"the instance has that on {few(having, _SHOWN)}, as robots say themselves"
    elif use := overlap(usual, foreign_uses(overlay.instance, link_names(overlay.instance), snapshot, None)):
        why = f"that one is taken by {use.where}"
    else:
        why = "its last placement has that"
    return (
        f"the overlay takes {overlay.subnet} on {few(new, _SHOWN)}, and not {usual} as by its name: {why}; "
        f"{_LOST} (network.subnet says which it shall be)",
    )


def notes_of_a_plan_from_elsewhere(instance: str, steps: Iterable[Step]) -> Iterator[str]:
    """Yield a note for each subnet that is new on a robot, and that an instance's name does not say.

    The line of a new network does not tell it, and what notes such a file has is its writer's word, too.
    """
    new: dict[str, set[str]] = {}
    for step in steps:
        if step.want and isinstance(step.want.params, NetworkParams):
            new.setdefault(step.want.params.subnet, set()).add(step.host)
    for subnet, robots in sorted(new.items()):
        if subnet != str(usual := _usual(instance)):
            why = "by the word of the plan, which was not written here"
            where = few(sorted(robots), _SHOWN)
            yield f"the overlay takes {subnet} on {where}, and not {usual} as by its name: {why}; {_LOST}"


def _usual(instance: str) -> IPv4Network:
    """Return the subnet that an instance's name gives where nothing else has it."""
    return identify(instance, NetworkSettings(), Snapshot(facts={}, observed={})).subnet


def _networks(overlay: Overlay, snapshot: Snapshot) -> Iterator[tuple[str, State]]:
    """Yield each robot that has the overlay's network, with the state of that."""
    for robot, things in snapshot.observed.items():
        for one in things:
            if (one.module, one.name, one.instance) == ("network", overlay.network, overlay.instance):
                yield robot, one.state
