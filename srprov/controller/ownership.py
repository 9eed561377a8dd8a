"""What robots say of an instance: whom to believe, where its services run now, and whose it is.

Reads what this machine remembers of the instance; all else is pure.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import msgspec
from msgspec.structs import replace

from srprov.codes import Code
from srprov.errors import RefusedError, visible
from srprov.facts.model import Snapshot
from srprov.modules import RUNNING
from srprov.network.belief import Belief, believe
from srprov.network.identity import link_names, tunnel_links
from srprov.network.record import read_record
from srprov.record.memory import Memory, digest, recall
from srprov.resource import Observed
from srprov.untrusted import string

_LONGEST = 300
"""Characters of what a robot says of who made an instance."""


def trusting(snapshot: Snapshot, instance: str, *, adopt: bool) -> tuple[Snapshot, tuple[str, ...]]:
    """Return the snapshot with the record of an instance that is believed, and notes for the plan.

    Raises:
        RefusedError: Robots say of others what nobody else says, and `adopt` is not given.
    """
    belief = _belief(snapshot, instance)
    if belief.doubts and not adopt:
        raise RefusedError(
            f"what robots say of instance '{instance}' cannot be checked by a run of this machine: "
            + "; ".join(belief.doubts),
            hint="look at these robots, or wait for those that are away; --adopt believes the record that most hold",
            code=Code.DISPUTED,
        )
    records = {
        robot: {name: one for name, one in held.items() if name != instance or robot in belief.holders}
        for robot, held in snapshot.records.items()
    }
    record = belief.claimed if adopt else belief.record
    placements = {instance: record} if record is not None else {}
    return replace(snapshot, placements=placements, records=records), belief.notes


class Looked(msgspec.Struct, frozen=True, kw_only=True):
    """What who changes nothing goes by."""

    snapshot: Snapshot
    """With the placements that are believed."""
    disputes: tuple[str, ...]
    """In words; what is disputed counts for nobody but the robot that says it."""
    notes: tuple[str, ...]
    unsure: tuple[str, ...]
    """Robots that may know of a later placement of this machine's than the one that is believed."""


def looking(snapshot: Snapshot, instance: str = "") -> Looked:
    """Return what is believed of an instance, or of all; nothing is refused."""
    disputes: list[str] = []
    notes: list[str] = []
    unsure: list[str] = []
    placements: dict[str, Mapping[str, Any]] = {}
    for name in sorted({name for held in snapshot.records.values() for name in held if instance in ("", name)}):
        belief = _belief(snapshot, name)
        record = belief.record if belief.disputes else belief.claimed
        placements |= {name: record} if record is not None else {}
        disputes += [f"instance '{name}': robots disagree: {one}" for one in belief.disputes]
        notes += [f"instance '{name}': {one}" for one in (*belief.absent, *belief.notes)]
        unsure += belief.unsure
    believed = replace(snapshot, placements=placements)
    return Looked(snapshot=believed, disputes=tuple(disputes), notes=tuple(notes), unsure=tuple(unsure))


def _belief(snapshot: Snapshot, instance: str) -> Belief:
    memory = recall(instance)
    order = {record: at for at, record in enumerate(memory.records)}
    newest = len(memory.records) - 1
    keepers = memory.robots - strangers(snapshot, memory)
    return believe(instance, snapshot, keepers, lambda record: order.get(digest(record), -1), newest)


def strangers(snapshot: Snapshot, memory: Memory) -> frozenset[str]:
    """Return the robots that are called as others to which this machine's last run of an instance gave a record.

    Each laboratory has a robot1, and that record may say of one what another had.
    """
    found = (robot for robot, proof in snapshot.proofs.items() if memory.proofs.get(robot, "") != proof)
    return memory.robots.intersection(found)


def sure_homes(snapshot: Snapshot, instance: str) -> dict[str, str]:
    """Return service -> robot of an instance, where nobody disputes it and the robot is the one that is meant."""
    looked = looking(snapshot, instance)
    record = read_record(looked.snapshot.placements.get(instance))
    if record is None or looked.disputes or looked.unsure:
        return {}
    others = strangers(snapshot, recall(instance))
    return {service: robot for service, robot in record.robots.items() if robot not in others}


def previous_robots(snapshot: Snapshot, instance: str) -> dict[str, str]:
    """Return service -> robot as it is now: by the labels of containers, else by the record of the last placement.

    The record speaks for robots that cannot be reached, and for a run that was cut off before it started a container.

    A run that was cut off in the middle of a move can leave two containers; the one that runs counts.
    """
    known = read_record(snapshot.placements.get(instance))
    previous = dict(known.robots) if known else {}
    seen: dict[str, tuple[int, str]] = {}
    for host, items in snapshot.observed.items():
        for item in items:
            if item.instance == instance and item.service:
                service = item.service
                recorded = bool(known and known.robots.get(service) == host)
                rank = (0 if item.state["state"] == "running" else 1) * 2 + (0 if recorded else 1)
                seen[service] = min(seen.get(service, (9, "")), (rank, host))
    return previous | {service: host for service, (_, host) in seen.items()}


def absent(snapshot: Snapshot, instance: str, known: Mapping[str, str], services: Iterable[str]) -> list[str]:
    """Return the services that are new, or whose container is gone from a robot that can be seen."""
    there = {
        (host, item.service)
        for host, items in snapshot.observed.items()
        for item in items
        if item.module in RUNNING and item.instance == instance
    }
    gone = {name for name, host in known.items() if host in snapshot.facts and (host, name) not in there}
    return [name for name in services if name not in known or name in gone]


def check_source(snapshot: Snapshot, instance: str, source: str, *, adopt: bool) -> None:
    """Refuse to take over what another experiment of the same name made."""
    if not adopt and (said := made_by_another(snapshot, instance, source)):
        hint = "run it under another name with --instance NAME, destroy the other one, or take it over with --adopt"
        raise RefusedError(said, hint=hint, code=Code.OWNER)


def made_by_another(snapshot: Snapshot, instance: str, source: str) -> str:
    """Return, in words, which other experiment made an instance, and where; nothing where it is this one's."""
    known = read_record(snapshot.placements.get(instance))
    labelled = sorted(
        {
            item.state["source"]
            for items in snapshot.observed.values()
            for item in items
            if item.module in RUNNING and item.instance == instance and item.state["source"]
        }
    )
    owners = [known.source] if known and known.source else labelled
    if not owners:
        return ""
    strange = {"these robots": owners[0]} if source not in owners else _made_otherwise(snapshot, instance, source)
    for where, other in sorted(strange.items()):
        return f"instance '{instance}' on {where} was made from {shown_maker(other)}, not from {source}"
    return ""


def makers_of(snapshot: Snapshot, instance: str, source: str = "") -> frozenset[str]:
    """Return who made what robots have of an instance, whomever one believes, and the source of a plan."""
    items = (item for items in snapshot.observed.values() for item in items if item.instance == instance)
    labelled = {str(item.state.get("source", "")) for item in items}
    recorded = {str(held[instance].get("source", "")) for held in snapshot.records.values() if instance in held}
    return frozenset({source, string(source), *labelled, *recorded} - {""})


def shown_maker(source: str) -> str:
    """Return, for a sentence, which experiment robots say made something: a second line would stand where hints do."""
    return visible(source[:_LONGEST])


def _made_otherwise(snapshot: Snapshot, instance: str, source: str) -> dict[str, str]:
    """Return robot -> who made its containers, where nothing that the robot itself says names `source`.

    Else one robot that names it, by a label of its own making, gives away what another experiment has on the others.
    """
    found = {}
    for robot, items in snapshot.observed.items():
        every = [one.state["source"] for one in items if one.module in RUNNING and one.instance == instance]
        said = sorted({*every} - {""})
        if not said or source in said:
            continue
        known = read_record(snapshot.records.get(robot, {}).get(instance))
        if known is None or known.source != source:
            found[robot] = str(said[0])
    return found


def owned(snapshot: Snapshot, instance: str) -> Mapping[str, tuple[Observed, ...]]:
    """Return what exists per robot; what was half made and names no instance is the instance's too.

    So is a link with its name and no alias yet. What a build left is whoever's who comes next: he has the robot's lock.
    """
    names, tunnels = link_names(instance), tunnel_links(instance)

    def claimed(item: Observed) -> Observed:
        half_made = item.name in names or (item.name in tunnels and item.state.get("inside") is False)
        half_made = half_made or bool(item.state.get("leftover"))
        return replace(item, instance=instance) if half_made and not item.instance else item

    return {host: tuple(claimed(item) for item in items) for host, items in snapshot.observed.items()}
