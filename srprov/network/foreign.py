"""What others have on the robots: everything that an instance's VNI and subnet must not meet.

Takes all robots as they are, gives what others use, in words. Pure. What robots say is untrusted: what is not of the
right shape counts as nothing.
"""

from __future__ import annotations

import bisect
from collections.abc import Iterable, Iterator, Mapping
from ipaddress import IPv4Network, IPv6Network, ip_network
from typing import Any

import msgspec

from srprov.facts.model import HostFacts, Snapshot
from srprov.untrusted import mapping, string

LARGEST = 8
"""Shortest prefix that counts as somebody's: a default route, or the two halves that a VPN puts in its place, use
nothing."""


class ForeignUse(msgspec.Struct, frozen=True):
    """Something that is not ours on a robot."""

    where: str
    """In words, for the error message."""
    subnet: IPv4Network | None = None
    vni: int = 0
    port: int = 0


def foreign_uses(
    instance: str, names: tuple[str, str], snapshot: Snapshot, ours: IPv4Network | None
) -> Iterator[ForeignUse]:
    """Return what others have; the clearest name of a thing that shows twice comes first.

    Args:
        instance: Whose own things are not foreign.
        names: Of its bridge and its VXLAN link.
        snapshot: All robots as they are.
        ours: The subnet that the instance has now.
    """
    said: set[tuple[object, ...]] = set()
    for robot, held in sorted(snapshot.records.items()):
        for other, placement in sorted(held.items()):
            claim = tuple(placement.get(key) for key in ("subnet", "vni", "port"))
            if other != instance and (other, *claim) not in said:  # of every robot: none can hide another's claim
                said.add((other, *claim))
                yield _of_another(f"instance '{other}' (as {robot} says)", *claim)
    for robot in sorted(snapshot.observed):
        yield from _networks(robot, instance, snapshot)
    for robot, facts in sorted(snapshot.facts.items()):
        yield from _on_robot(robot, facts, names, ours)
    for robot, held in sorted(snapshot.records.items()):
        yield from _members(robot, held, instance)


def of_robot(robot: str, instance: str, names: tuple[str, str], snapshot: Snapshot) -> Iterator[ForeignUse]:
    """Return what a robot itself says that others have on it, and whom they reach from there.

    What else its placement records say is about all robots.
    """
    yield from _networks(robot, instance, snapshot)
    if robot in snapshot.facts:
        yield from _on_robot(robot, snapshot.facts[robot], names, None)
    yield from _members(robot, snapshot.records.get(robot, {}), instance)


def lost_on_the_way(vteps: Mapping[str, str], instance: str, snapshot: Snapshot) -> tuple[str, str, ForeignUse] | None:
    """Return a robot, a peer's underlay address and the overlay of others into which the robot would send to it."""
    on = {robot: [*_networks(robot, instance, snapshot)] for robot in sorted(snapshot.observed.keys() & vteps.keys())}
    every = Ranges(use.subnet for uses in on.values() for use in uses)
    near = {robot: peer for robot, vtep in vteps.items() if (peer := to_network(vtep)) and every.meet(peer)}
    for robot, uses in on.items():
        for name, peer in near.items():
            if name != robot and (use := overlap(peer, uses)):
                return robot, vteps[name], use
    return None


class Ranges:
    """Networks as ranges of addresses that are asked many times: robots may say thousands of them."""

    def __init__(self, networks: Iterable[IPv4Network | None]) -> None:
        """Take networks; None is none."""
        self._first: list[int] = []
        self._last: list[int] = []
        for first, last in sorted(map(_range, filter(None, networks))):
            if self._last and first <= self._last[-1] + 1:
                self._last[-1] = max(self._last[-1], last)
            else:
                self._first.append(first)
                self._last.append(last)

    def meet(self, network: IPv4Network) -> bool:
        """Return whether an address of a network lies in one of them."""
        first, last = _range(network)
        at = bisect.bisect_left(self._last, first)
        return at < len(self._first) and self._first[at] <= last


def _range(network: IPv4Network) -> tuple[int, int]:
    return int(network.network_address), int(network.broadcast_address)


def overlap(wanted: IPv4Network, uses: Iterable[ForeignUse]) -> ForeignUse | None:
    """Return the first use that a network would overlap."""
    return next((use for use in uses if use.subnet is not None and use.subnet.overlaps(wanted)), None)


def to_network(text: object) -> IPv4Network | None:
    """Return the IPv4 network that an address with or without prefix length lies in; None for anything else."""
    if not isinstance(text, str):
        return None
    try:
        network: IPv4Network | IPv6Network = ip_network(text, strict=False)
    except ValueError:
        return None
    return network if isinstance(network, IPv4Network) and network.prefixlen >= LARGEST else None


def _on_robot(robot: str, facts: HostFacts, names: tuple[str, str], ours: IPv4Network | None) -> Iterator[ForeignUse]:
    """Return what a robot's links, routes and own address use; its routes over our own bridge do not count."""
    for link in facts.links:
        if link.name not in names:
            where = f"link {link.name} on {robot}"
            yield ForeignUse(where, vni=link.vni, port=link.port)
            yield from (ForeignUse(where, to_network(address)) for address in link.addresses)
    for subnet in routes_of(facts, names):
        if subnet != ours:
            yield ForeignUse(f"the route to {subnet} on {robot}", subnet)
    yield ForeignUse(f"the address of {robot}", to_network(facts.underlay_address))
    for address in facts.relies_on:
        where = f"{address}, which {robot} relies on (SSH client, gateway, name server or time server)"
        yield ForeignUse(where, to_network(address))


def routes_of(facts: HostFacts, names: tuple[str, str]) -> Iterator[IPv4Network]:
    """Return where a robot routes to, but for what lies behind the links of these names."""
    own = {to_network(address) for link in facts.links if link.name in names for address in link.addresses}
    for route in facts.routes:
        if (subnet := to_network(route)) is not None and subnet not in own:
            yield subnet


def lifelines(facts: HostFacts, names: tuple[str, str]) -> Iterator[IPv4Network]:
    """Return the single addresses that a robot would be lost without: its own, and those that it relies on."""
    own = (address.partition("/")[0] for link in facts.links if link.name not in names for address in link.addresses)
    for text in (facts.underlay_address, *facts.relies_on, *own):
        if (address := to_network(text)) is not None:
            yield address


def _members(robot: str, held: Mapping[str, Mapping[str, Any]], instance: str) -> Iterator[ForeignUse]:
    """Return the underlay addresses that other instances send to: a member may be in reach of nobody but its peers.

    Where it is reached by the default route, no route says that its address is in use.
    """
    said: set[str] = set()
    for other, placement in sorted(held.items()):
        members = mapping(placement.get("robots")).values() if other != instance else ()
        for one in members:
            vtep = string(mapping(one).get("vtep"))
            address = to_network(vtep) if vtep not in said else None
            said.add(vtep)
            if address is not None and address.prefixlen == address.max_prefixlen:
                yield ForeignUse(f"{vtep}, a member of instance '{other}' (as {robot} says)", address)


def _networks(robot: str, instance: str, snapshot: Snapshot) -> Iterator[ForeignUse]:
    """Yield what the Docker networks on a robot use, but for the instance's own."""
    for thing in snapshot.observed.get(robot, ()):
        if "subnet" in thing.state and thing.instance != instance:
            claim = (thing.state.get(key) for key in ("subnet", "vni", "port"))
            yield _of_another(f"network '{thing.name}' on {robot}", *claim)


def _of_another(where: str, subnet: object, vni: object, port: object) -> ForeignUse:
    return ForeignUse(
        where,
        subnet=to_network(subnet),
        vni=vni if isinstance(vni, int) else 0,
        port=port if isinstance(port, int) else 0,
    )
