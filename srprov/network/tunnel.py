"""What encrypts an overlay: WireGuard between its members, and the overlay's VXLAN inside of it.

Takes the members and all robots as they are; gives a `Tunnel`. Pure. On each member the interface and the VXLAN's
socket are in a network namespace of their own, where a robot's address is its gateway's on the overlay: nothing else
is in there that could have it. Two interfaces, `a` and `b`, take turns when keys change.

Source: WireGuard adds 60 bytes to a packet over IPv4 (IP 20, UDP 8, its header 16, tag 16) and 80 over IPv6. It also
fills packets up to a multiple of 16 bytes, up to the interface's MTU; `wireguard-go` may take that for its default
1420, so that 15 bytes, and one more to have even numbers, are left free for them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping

from srprov.codes import Code
from srprov.definitions.containermodel import TUNNEL_PORTS
from srprov.definitions.model import Experiment
from srprov.errors import UsageError
from srprov.facts.model import Snapshot
from srprov.network.identity import number, tunnel_name
from srprov.network.model import Tunnel

OVERHEAD = {4: 76, 6: 96}
"""Bytes that WireGuard adds at most, by IP version of the underlay."""


def tunnel_of(
    instance: str, experiment: Experiment, vteps: Mapping[str, str], snapshot: Snapshot, *, mtu: int, rotate: bool
) -> Tunnel | None:
    """Return the tunnel of an overlay; None for one that is not encrypted.

    Args:
        instance: The instance id.
        experiment: Whether it is encrypted, and which ports its services have.
        vteps: Member robot -> underlay address.
        snapshot: All robots as they are.
        mtu: Of what goes through it, in bytes.
        rotate: The interface that is not in use becomes the one that is: with new keys.

    Raises:
        UsageError: Keys cannot be rotated.
    """
    if experiment.network.encryption != "wireguard":
        if rotate:
            raise UsageError(
                "its overlay is not encrypted: there are no keys", hint="leave out --rotate-keys", code=Code.ENCRYPTION
            )
        return None
    if experiment.network.persist:
        message = "network.persist cannot restore an overlay that is encrypted: its keys are gone after a reboot"
        raise UsageError(message, hint="leave out network.persist, and apply after a reboot", code=Code.ENCRYPTION)
    away = sorted(vteps.keys() & snapshot.unreachable.keys())
    if rotate and away:
        message = f"keys change on all robots of an overlay at once, and {', '.join(away)} cannot be reached"
        raise UsageError(message, hint="rotate them when every robot answers", code=Code.ENCRYPTION)
    netns = tunnel_name(instance)
    slot = _slot(netns, snapshot)
    slot = "ab"[slot == "a"] if rotate and slot else slot or "a"
    port = _port(instance, experiment, snapshot) + "ab".index(slot)
    return Tunnel(
        netns=netns,
        interface=netns + slot,
        port=port,
        mtu=mtu,
        endpoints={robot: f"[{vtep}]:{port}" if ":" in vtep else f"{vtep}:{port}" for robot, vtep in vteps.items()},
    )


def _slot(netns: str, snapshot: Snapshot) -> str:
    """Return which interface most robots have, and of two which one most send through; empty when none is there."""
    there = Counter(name[-1] for name, _ in _interfaces(snapshot) if name[:-1] == netns)
    used: Counter[str] = Counter()
    for things in snapshot.observed.values():
        for thing in things:
            if thing.name == netns and "through" in thing.state:
                used.update({interface[-1:] for interface in thing.state["through"].values()})
    return max(sorted(there), key=lambda slot: (there[slot], used[slot]), default="")


def _port(instance: str, experiment: Experiment, snapshot: Snapshot) -> int:
    """Return the first port of a pair: what the instance has, else by hash the first pair that nothing has."""
    netns, taken, ours = tunnel_name(instance), set[int](), Counter[int]()
    for name, port in _interfaces(snapshot):
        if name[:-1] == netns:
            ours[port - "ab".index(name[-1])] += 1
        else:
            taken.add(port)
    pairs = TUNNEL_PORTS[::2]
    if used := [port for port in ours if port in pairs]:
        return min(used, key=lambda port: (-ours[port], port))
    taken |= {one.port for ports in snapshot.taken.values() for one in ports if one.protocol == "udp"}
    taken |= _published(experiment)
    start = number("wireguard", instance) % len(pairs)
    free = (pair for i in range(len(pairs)) if taken.isdisjoint((pair := pairs[(start + i) % len(pairs)], pair + 1)))
    port = next(free, 0)
    if not port:
        raise UsageError(
            f"no UDP port from {pairs[0]} to {pairs[-1] + 1} is free on all robots", code=Code.NETWORK_ABILITY
        )
    return port


def _interfaces(snapshot: Snapshot) -> Iterator[tuple[str, int]]:
    """Yield name and UDP port of all WireGuard interfaces of ours, of every instance, that have one."""
    for things in snapshot.observed.values():
        for thing in things:
            if port := thing.state.get("listen_port"):
                yield thing.name, port


def _published(experiment: Experiment) -> set[int]:
    every = (port for service in experiment.services.values() for port in service.runtime.ports)
    return {published for _, published, _, protocol in every if protocol == "udp"}
