"""Where the services of a running instance are, and which of them a user's words mean.

Takes robots as they were found, and what this machine remembers of its runs; changes nothing.
"""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from typing import Any

import msgspec

from srprov.codes import Code
from srprov.controller.ownership import looking, strangers, sure_homes
from srprov.definitions.expand import expand
from srprov.definitions.model import Experiment, Service
from srprov.errors import UsageError, did_you_mean
from srprov.facts.model import Snapshot
from srprov.modules import RUNNING
from srprov.modules.container_names import container_name
from srprov.network.record import PlacementRecord, read_record
from srprov.record.memory import digest, recall
from srprov.resource import Observed


class Located(msgspec.Struct, frozen=True, kw_only=True):
    """A service, or an instance of it, and its robot."""

    service: str
    host: str
    container: str
    """The container's name."""
    found: Observed | None = None
    """None: it is not there, or its robot is out of reach."""
    stray: bool = False
    """It is elsewhere than where the service was placed, or robots do not agree where that is."""
    placed: bool = True
    """The record that is believed has it there, of this machine's or as another robot has it, too; else only its robot
    says so."""

    @property
    def where(self) -> str:
        """Return it in words."""
        return f"{self.service} on {self.host}"


class Whereabouts(msgspec.Struct, frozen=True, kw_only=True):
    """All services of an instance."""

    instance: str
    services: tuple[Located, ...]
    by_name: Mapping[str, Service]
    """What the EDF says of each instance; empty where it is not known."""
    families: Mapping[str, frozenset[str]]
    """Service of the EDF that runs several times -> the names of its instances."""
    notes: tuple[str, ...] = ()
    """What robots say that contradicts others, or that nobody can confirm."""
    unreachable: Mapping[str, str]
    remembered: bool = True
    """A run of this machine wrote the placement that counts; else only robots say where services are."""
    unsure: tuple[str, ...] = ()
    """Robots that may know of a later placement of this machine's: a run of it did not come to its end."""
    source: str = ""
    """Which experiment the placement that counts is of."""
    strangers: frozenset[str] = frozenset()
    """Robots that are called as others of this machine's last run."""

    def named(self, words: Sequence[str]) -> tuple[Located, ...]:
        """Return what words mean: `SERVICE`, an instance of it, or `SERVICE@ROBOT`; without any, all services.

        What is elsewhere than where it was placed is meant only by `SERVICE@ROBOT`.

        Raises:
            UsageError: A word names nothing.
        """
        if not words:
            return tuple(one for one in self.services if not one.stray)
        found = {(one.service, one.host): one for word in words for one in self._of(word)}
        return tuple(found[key] for key in sorted(found))

    def _of(self, word: str) -> list[Located]:
        service, _, robot = word.partition("@")
        names = {service, *self.families.get(service, ())}
        some = [one for one in self.services if one.service in names and robot in ("", one.host)]
        found = some if robot else [one for one in some if not one.stray]
        if found:
            return found
        if some:
            places = " or ".join(f"{one.service}@{one.host}" for one in some)
            raise UsageError(
                f"it is not sure where {service} was placed",
                hint=f"name it with its robot: {places}",
                code=Code.DISPUTED,
            )
        raise self._unknown(word)

    def _unknown(self, word: str) -> UsageError:
        known, service = {one.service for one in self.services}, word.partition("@")[0]
        near = "" if service in known else did_you_mean(service, known | set(self.families))
        there = f"there are: {', '.join(sorted(known)) or 'none'}"
        away = f"; {', '.join(sorted(self.unreachable))} cannot be reached" if self.unreachable else ""
        return UsageError(
            f"{self.instance} has no {word} on these robots{away}",
            hint=f"{near} {there}" if near else f"{there}; `srprov apply` makes them",
            code=Code.NOTHING_RUNS,
        )


def locate(snapshot: Snapshot, instance: str, experiment: Experiment | None = None) -> Whereabouts:
    """Return where each service of an instance is, by the believed placement and what was found.

    Args:
        snapshot: The robots as they are.
        instance: The instance's id.
        experiment: What the EDF says.
    """
    looked, memory = looking(snapshot, instance), recall(instance)
    placement = looked.snapshot.placements.get(instance)
    record = read_record(placement) or PlacementRecord()
    homes = {} if looked.disputes else dict(record.robots)
    by_name = _expanded(snapshot, record, experiment)
    remembered = placement is not None and digest(placement) in memory.records
    sure = set(homes.items()) if remembered else _witnessed(snapshot, instance)
    services = _services(snapshot, instance, homes, sure, disputed=bool(looked.disputes))
    return Whereabouts(
        instance=instance,
        services=tuple(sorted(services, key=lambda one: (one.service, one.host))),
        by_name=by_name,
        families=_families(by_name),
        notes=(*looked.disputes, *looked.notes),
        unreachable=snapshot.unreachable,
        remembered=remembered,
        unsure=looked.unsure,
        source=record.source,
        strangers=strangers(snapshot, memory),
    )


def _services(
    snapshot: Snapshot, instance: str, homes: Mapping[str, str], sure: Container[tuple[str, str]], *, disputed: bool
) -> list[Located]:
    """Return what was placed and what was found; of `sure`, service and robot, it is known that it is there."""
    there = {
        (item.service, host): item
        for host, items in snapshot.observed.items()
        for item in items
        if item.module in RUNNING and item.instance == instance
    }
    placed = [
        Located(
            service=one, host=host, container=container_name(instance, one), found=there.get((one, host)),
            placed=(one, host) in sure,
        )
        for one, host in homes.items()
    ]  # fmt: skip
    return placed + [
        Located(
            service=one, host=host, container=item.name, found=item, stray=disputed or one in homes,
            placed=(one, host) in sure,
        )
        for (one, host), item in there.items()
        if homes.get(one) != host
    ]  # fmt: skip


def _witnessed(snapshot: Snapshot, instance: str) -> set[tuple[str, str]]:
    """Return (service, robot) of what another robot's record has there: whoever places an instance tells all robots.

    Where there is only one robot, it has nobody to tell.
    """
    alone = len(snapshot.facts.keys() | snapshot.unreachable.keys()) < 2
    holders: dict[int, list[str]] = {}
    records: dict[int, Mapping[str, Any]] = {}
    for robot, held in snapshot.records.items():
        if (record := held.get(instance)) is not None:
            holders.setdefault(id(record), []).append(robot)
            records[id(record)] = record
    return {
        (service, robot)
        for key, record in records.items()
        for service, robot in (read_record(record) or PlacementRecord()).robots.items()
        if alone or holders[key] != [robot]
    }


def _expanded(snapshot: Snapshot, record: PlacementRecord, experiment: Experiment | None) -> Mapping[str, Service]:
    if experiment is None:
        return {}
    tags = {robot: facts.tags for robot, facts in snapshot.facts.items()}
    away = {name: robot for name, robot in record.robots.items() if robot in snapshot.unreachable}
    return expand(experiment, tags, away).services


def _families(services: Mapping[str, Service]) -> Mapping[str, frozenset[str]]:
    families: dict[str, set[str]] = {}
    for name, one in services.items():
        if one.instance_of:
            families.setdefault(one.instance_of, set()).add(name)
    return {name: frozenset(some) for name, some in families.items()}


def containers_of(snapshot: Snapshot, instance: str, services: Sequence[str]) -> list[tuple[str, str, str]]:
    """Return (label, robot, container's name) of the services that are named, also as SERVICE@ROBOT, or of all.

    The label is the service's name where the believed placement has it; anywhere else, or where robots contradict each
    other, it is `SERVICE@ROBOT`: a container may carry any service's name.

    Raises:
        UsageError: A service has no container on any robot, and no robot is out of reach.
    """
    there = sorted(
        (item.service, host, item.name)
        for host, items in snapshot.observed.items()
        for item in items
        if item.module in RUNNING and item.instance == instance
    )
    home = sure_homes(snapshot, instance)

    def labelled(chosen: Sequence[tuple[str, str, str]]) -> list[tuple[str, str, str]]:
        return [(name if home.get(name) == host else f"{name}@{host}", host, it) for name, host, it in chosen]

    known = [service for service, _, _ in there]
    unknown = sorted(set(services) - set(known) - {f"{service}@{host}" for service, host, _ in there})
    named = [one for one in there if not {one[0], f"{one[0]}@{one[1]}"}.isdisjoint(services)]
    if snapshot.unreachable and (unknown or not there):
        return labelled(named)  # what is missing may be on a robot that is away
    if unknown:
        listed = f"there are: {', '.join(known) or 'none'}"
        raise UsageError(
            f"no container of {', '.join(unknown)} on these robots",
            hint=" ".join(filter(None, (did_you_mean(unknown[0].partition("@")[0], known), listed))),
            code=Code.NOTHING_RUNS,
        )
    if not there:
        raise UsageError(
            f"nothing of {instance} on these robots", hint="srprov apply starts it", code=Code.NOTHING_RUNS
        )
    return labelled(named if services else there)
