"""What is there: the robots of one lab and how they are, and all labs of this machine. Only looks."""

from __future__ import annotations

from collections.abc import Set
from pathlib import Path

import msgspec

from srprov.lab import cgroups, faults, members, partition, robot, sites, spec, state
from srprov.lab.places import Site


class RobotStatus(msgspec.Struct, frozen=True):
    """A robot as `status` finds it."""

    name: str
    address: str
    state: str
    """`ready`, `booting` or `dead`."""
    memory: int | None
    """Bytes that its processes hold."""
    pid: int | None
    faults: tuple[str, ...] = ()
    """What was broken on purpose since it was booted, e.g. `cut off from all`, `docker stopped`."""


class LabStatus(msgspec.Struct, frozen=True):
    """A lab as `list` finds it."""

    name: str
    """Empty for the lab without a name."""
    robots: int
    alive: int
    """How many of the robots run."""
    subnet: str
    folders: tuple[str, ...]
    """Where `up` was run: each has the inventory."""
    since: str
    """When it was first brought up, in UTC."""


def robots(name: str) -> list[RobotStatus]:
    """Return the robots of the lab in the order of their numbers; none when it is down."""
    site = sites.find(name)
    lab = state.read_lab(site)
    if lab is None:
        return []
    cuts = partition.in_force(site)
    return [_look(site, each, cuts) for each in members.of(lab)]


def _look(site: Site, each: spec.Robot, cuts: Set[partition.Rule]) -> RobotStatus:
    where = str(site.address(each.name, each.lan))
    booted = state.read_robot(site, each.name)
    if booted is None:
        return RobotStatus(each.name, where, "dead", None, None, faults.cuts_of(site, each.name, cuts))
    ready = robot.is_ready(site, each, booted.init.pid, cuts)
    return RobotStatus(
        each.name,
        where,
        "ready" if ready else "booting",
        cgroups.memory(site, each.name),
        booted.init.pid,
        (*faults.cuts_of(site, each.name, cuts), *faults.of_robot(each, booted.init.pid)),
    )


def labs() -> list[LabStatus]:
    """Return the labs that are up on this machine; the one without a name comes first."""
    known = [(site, state.read_lab(site)) for site in sites.every()]
    return [_status_of(site, lab) for site, lab in known if lab is not None]


def _status_of(site: Site, lab: state.Lab) -> LabStatus:
    wanted = members.of(lab)
    alive = sum(state.read_robot(site, each.name) is not None for each in wanted)
    folders = tuple(str(Path(path).parents[1]) for path in lab.inventories)
    return LabStatus(site.name, len(wanted), alive, str(site.subnet), folders, lab.since)
