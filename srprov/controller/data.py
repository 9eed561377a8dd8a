"""Where the data of services is: which robot has the volume, whether it stays, and what is said when it does not.

Takes an experiment with every instance, the robots as they are and who owns the volumes; gives values. Pure. A service
with data stays where its data is unless the user says `--data move` or `--data leave`. A robot's word counts for what
is on itself: that one is a whole copy of another's is believed by the owner's label alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import msgspec
from msgspec.structs import replace

from srprov.controller.owners import Owner, identity
from srprov.controller.request import PlanRequest
from srprov.definitions.model import Experiment, Service
from srprov.facts.model import Snapshot
from srprov.modules import MODULES
from srprov.modules.volume import moment, volume_name
from srprov.resource import Observed


class Holdings(msgspec.Struct, frozen=True, kw_only=True):
    """Volumes with data: name -> robot -> what was found. Half copies are none."""

    there: Mapping[str, Mapping[str, Observed]]
    """Of the owner, without those that were copied elsewhere."""
    copied: Mapping[tuple[str, str], str]
    """Robot and name of a whole copy -> the robot that still has what it was copied from."""
    strange: tuple[tuple[str, Observed], ...]
    """Robot and volume, of somebody else; also those that are taken over now."""

    @property
    def adopted(self) -> frozenset[str]:
        """What is to be remembered as taken over."""
        return frozenset(identity(robot, item) for robot, item in self.strange)


def holdings(snapshot: Snapshot, instance: str, owner: Owner | None, *, adopt: bool) -> Holdings:
    """Return the data of an instance; without an owner nobody asks whose it is."""
    there: dict[str, dict[str, Observed]] = {}
    strange: list[tuple[str, Observed]] = []
    for robot, item in _volumes(snapshot, instance):
        mine = owner is None or owner.knows(robot, item)
        if not mine:
            strange.append((robot, item))
        if mine or adopt:
            there.setdefault(item.name, {})[robot] = item
    copied = {
        (target, name): source
        for name, robots in there.items()
        for target, copy in robots.items()
        for source, item in robots.items()
        if owner and copy.state["copy"] == owner.copy_label(source, item.state["created"], target, name)
    }
    for (_, name), source in copied.items():
        there[name].pop(source, None)
    return Holdings(there=there, copied=copied, strange=tuple(strange))


class DataNow(msgspec.Struct, frozen=True, kw_only=True):
    """Where data is before anything is decided."""

    instance: str
    held: Holdings
    home: Mapping[str, str]
    """Service -> the robot that has its data."""


def data_now(
    experiment: Experiment, snapshot: Snapshot, instance: str, previous: Mapping[str, str], request: PlanRequest
) -> DataNow:
    """Return where the data of each service is; the newest where several robots have some, and it runs on none.

    Of a robot that cannot be reached, the owner remembers what was last made there.
    """
    held = holdings(snapshot, instance, request.owner, adopt=request.adopt)
    home: dict[str, str] = {}
    known = request.owner.places if request.owner else {}
    for name, service in experiment.services.items():
        volumes = roaming(service, instance)
        before = previous.get(name, "")
        having = {robot: item for volume in volumes for robot, item in held.there.get(volume, {}).items()}
        if volumes and (before in snapshot.unreachable or before in having):
            home[name] = before
        elif having:
            home[name] = newest(having)
        elif away := [robot for one in volumes if (robot := known.get(one, "")) in snapshot.unreachable]:
            home[name] = away[0]
    return DataNow(instance=instance, held=held, home=home)


def held_fast(experiment: Experiment, home: Mapping[str, str], snapshot: Snapshot) -> Experiment:
    """Return the experiment with services that stay where their data is; a pin elsewhere is not argued with."""
    services = {
        name: replace(one, data_on=home[name])
        if home.get(name) in snapshot.facts and one.robot in ("", home[name])
        else one
        for name, one in experiment.services.items()
    }
    return replace(experiment, services=services)


def _volumes(snapshot: Snapshot, instance: str) -> Iterator[tuple[str, Observed]]:
    for robot, items in sorted(snapshot.observed.items()):
        for item in items:
            module = MODULES[item.module]
            if module.holds_data and item.instance == instance and module.keeps(item.state):
                yield robot, item


def used(experiment: Experiment, placed: Mapping[str, str], instance: str) -> set[tuple[str, str]]:
    """Return robot and name of every volume that a service will use."""
    every = ((placed.get(name, ""), one) for name, one in experiment.services.items())
    return {(robot, volume) for robot, one in every for volume in mounted(one, instance)}


def mounted(service: Service, instance: str) -> list[str]:
    """Return the names of the volumes that a service mounts."""
    return sorted({volume_name(instance, one.source) for one in service.runtime.mounts if one.kind == "volume"})


def roaming(service: Service, instance: str) -> list[str]:
    """Return the volumes of a service that may be here or there; one with `per_robot` has its data on each robot."""
    return [] if service.per_robot is not None else mounted(service, instance)


def newest(having: Mapping[str, Observed]) -> str:
    """Return the robot whose volume was made last, by the engines' clocks; empty when there is none."""
    return max(having, key=lambda robot: (moment(having[robot].state["created"]), robot), default="")
