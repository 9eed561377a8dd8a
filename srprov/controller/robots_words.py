"""What robots' own words mean for services: whose home is where, and names that are too many to be read.

Takes services where they are placed, and facts; gives the experiment with paths of its robots, and notes. Pure. What a
robot says of a home is shown in the plan and asked for by the permission of a mount there, like any path of an EDF.
"""

from __future__ import annotations

import posixpath
from collections.abc import Iterator, Mapping

from msgspec.structs import replace

from srprov.controller.services import with_robots_network
from srprov.definitions.containermodel import Mount
from srprov.definitions.model import Experiment, Service
from srprov.facts.model import HostFacts
from srprov.facts.spelled import MOST_LINES

Facts = Mapping[str, HostFacts]


def at_home(experiment: Experiment, placed: Mapping[str, str], facts: Facts) -> Experiment:
    """Return the experiment with absolute paths for `~USER/…`; of a robot out of reach, none is known."""
    services = {name: _resolved(one, facts.get(placed.get(name, ""))) for name, one in experiment.services.items()}
    return replace(experiment, services=services)


def _resolved(service: Service, robot: HostFacts | None) -> Service:
    mounts = service.runtime.mounts
    if robot is None or not any(one.home_of for one in mounts):
        return service
    found = tuple(_absolute(one, robot.home(one.home_of)) if one.home_of else one for one in mounts)
    return replace(service, runtime=replace(service.runtime, mounts=found))


def _absolute(mount: Mount, home: str) -> Mount:
    below = mount.source.removeprefix(f"~{mount.home_of}")
    return replace(mount, source=posixpath.normpath(f"/{home.strip('/')}{below}"))


def names_notes(experiment: Experiment, placed: Mapping[str, str], facts: Facts) -> Iterator[str]:
    """Return a note for each robot that has more names than containers with its network get."""
    services = experiment.services
    robots = {robot for name, robot in placed.items() if name in services and with_robots_network(services[name])}
    for robot in sorted(robots):
        if robot in facts and facts[robot].hosts_cut:
            yield (
                f"{robot}: its /etc/hosts is long; of its names containers have those of the first {MOST_LINES} lines"
            )
