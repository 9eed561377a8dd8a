"""The robots' ports as a resource: on one robot a port, protocol and address is somebody's, or nobody's.

Takes services, where those are that are not decided here, and what others have; gives groups of services of which a
robot runs one at most, and what a robot lacks. Pure. A service has the ports that it publishes, and with the robot's
network those that it exposes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from srprov.assignment.apart import maximal
from srprov.assignment.requirements import UnmetRequirement
from srprov.definitions.containermodel import EVERYWHERE, Port, ports_meet
from srprov.definitions.model import Service
from srprov.facts.model import TakenPort

_Holder = tuple[Port, str, str]
"""What is taken: the port, the experiment's service or nothing, by whom in words."""
Holders = Mapping[str, Mapping[tuple[int, str], Sequence[_Holder]]]
"""Robot -> (port, protocol) -> who has it there."""


def declared(service: Service) -> tuple[Port, ...]:
    """Return the ports of the robot that a service has while it runs."""
    run = service.runtime
    own = run.expose if service.network in ("host", "both") else ()
    return (*run.ports, *(("", port, port, protocol) for port, protocol in own))


def exclusive(services: Mapping[str, Service]) -> dict[tuple[str, ...], str]:
    """Return the groups of services of which a robot can run one at most -> a port that each of them has.

    A group whose services are all in another one is left out: it forbids nothing that the other does not.

    Raises:
        UsageError: There are more than can be searched with.
    """
    names = sorted(services)
    told: dict[int, str] = {}
    for (port, protocol), by_address in sorted(_users(services, names).items()):
        everywhere = by_address.pop("", 0)
        # many addresses may be the same services'
        for some in dict.fromkeys(by_address.values()) if by_address else (0,):
            if (some | everywhere).bit_count() > 1:
                told.setdefault(some | everywhere, f"{port}/{protocol}")
    groups = {tuple(_members(bits)): port for bits, port in told.items()}
    return {tuple(names[index] for index in group): groups[group] for group in maximal(groups)}


def shared(services: Iterable[Service]) -> list[str]:
    """Return the ports that two or more of some services have in common, such as `8080/tcp`."""
    by_name = {one.name: one for one in services}
    found = []
    for (port, protocol), by_address in sorted(_users(by_name, sorted(by_name)).items()):
        everywhere = by_address.pop("", 0)
        if any((some | everywhere).bit_count() > 1 for some in (*by_address.values(), 0)):
            found.append(f"{port}/{protocol}")
    return found


def _users(services: Mapping[str, Service], names: Sequence[str]) -> dict[tuple[int, str], dict[str, int]]:
    """Return port and protocol -> address, or nothing for all -> who has it there: a bit for each of the names."""
    alike: dict[tuple[int, str], tuple[Service, int]] = {}  # replicas have one runtime
    for bit, name in enumerate(names):
        one = services[name]
        key = id(one.runtime), one.network
        alike[key] = one, alike.get(key, (one, 0))[1] | 1 << bit
    users: dict[tuple[int, str], dict[str, int]] = {}
    for one, bits in alike.values():
        for address, port, _, protocol in declared(one):
            of_port = users.setdefault((port, protocol), {})
            where = "" if address in EVERYWHERE else address
            of_port[where] = of_port.get(where, 0) | bits
    return users


def _members(bits: int) -> Iterator[int]:
    """Return the positions of the bits that are set, rising."""
    while bits:
        low = bits & -bits
        yield low.bit_length() - 1
        bits ^= low


def holders(
    services: Mapping[str, Service], stay: Mapping[str, str], taken: Mapping[str, Iterable[TakenPort]]
) -> Holders:
    """Return what is taken on each robot: by services whose robot is not decided here, and by others."""
    found: dict[str, dict[tuple[int, str], list[tuple[Port, str, str]]]] = {}
    for name, robot in stay.items():
        for port in declared(services[name]):
            found.setdefault(robot, {}).setdefault((port[1], port[3]), []).append((port, name, f"'{name}'"))
    for robot, some in taken.items():
        for one in some:
            port = (one.address, one.port, one.port, one.protocol)
            found.setdefault(robot, {}).setdefault((one.port, one.protocol), []).append((port, "", one.by))
    return found


def missing_ports(service: Service, robot: str, held: Holders) -> Iterator[UnmetRequirement]:
    """Return the ports of a robot that a service would have, and others have."""
    there = held.get(robot, {})
    for port in declared(service) if there else ():
        by = _taken_by(service.name, port, there.get((port[1], port[3]), ()))
        if by:
            remedy = f"publish another port than {port[1]}/{port[3]} in '{service.instance_of or service.name}'"
            yield UnmetRequirement(f"port {port[1]}/{port[3]} is taken by {by}", remedy)


def without_taken(
    capable: Mapping[str, int], services: Mapping[str, Service], robots: Sequence[str], held: Holders
) -> dict[str, int]:
    """Return the rows of the capability matrix without the robots on which a port of the service is taken."""
    crowded: dict[tuple[int, str], list[tuple[int, Sequence[_Holder]]]] = {}
    for bit, robot in enumerate(robots):
        for key, holding in held.get(robot, {}).items():
            crowded.setdefault(key, []).append((1 << bit, holding))
    rows = dict(capable)
    for name in capable if crowded else ():
        for port in declared(services[name]):
            for mark, holding in crowded.get((port[1], port[3]), ()):
                if _taken_by(name, port, holding):
                    rows[name] &= ~mark
    return rows


def _taken_by(name: str, port: Port, holding: Iterable[_Holder]) -> str:
    """Return who has a port that a service would have, or nothing."""
    return next((by for other, holder, by in holding if holder != name and ports_meet(port, other)), "")
