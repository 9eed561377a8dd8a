"""Fixed addresses on the overlay: IP and MAC per service, gateway per robot.

Takes the instance, its subnet, the names and what is in use; gives addresses. Pure. An address is a hash of instance
and name and the next free one on collision, never a position in a list, so that adding or removing a name changes
nobody else's. What the instance uses already wins; what a removed service had is free again.

Source: the hash is `identity.number`, documented in docs/network.md. Bit 1 of a MAC's first byte marks it as locally
administered (IEEE 802).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from ipaddress import IPv4Address, IPv4Network

import msgspec

from srprov.codes import Code
from srprov.errors import UsageError
from srprov.network.identity import number
from srprov.network.record import PlacementRecord


class Addresses(msgspec.Struct, frozen=True, kw_only=True):
    """Who has which address; every address belongs to one name only."""

    services: Mapping[str, str]
    gateways: Mapping[str, str]
    """Robot -> the address of its bridge: one for all would be a duplicate on the segment."""
    macs: Mapping[str, str]
    """Service -> `02:…`"""


def allocate(
    instance: str,
    subnet: IPv4Network,
    services: Iterable[str],
    robots: Iterable[str],
    used: PlacementRecord | None = None,
) -> Addresses:
    """Return an IP and a MAC for every service, and a gateway address for every robot.

    Args:
        instance: The instance id.
        subnet: All of it but its first (network) and last (broadcast) address can be given out.
        services: Names of services on the overlay, in any order.
        robots: Names of robots that are members, in any order.
        used: The last placement; its addresses win as far as they lie in the subnet.

    Raises:
        UsageError: More names than addresses.
    """
    used = used or PlacementRecord()
    wanted = [("gateway", name) for name in sorted(set(robots))] + [("service", name) for name in sorted(set(services))]
    if len(wanted) > subnet.num_addresses - 2:
        message = f"subnet {subnet} has {subnet.num_addresses - 2} addresses, {len(wanted)} are needed"
        raise UsageError(message, hint="name a larger network.subnet in the EDF", code=Code.SUBNET)
    first, count = int(subnet.network_address) + 1, subnet.num_addresses - 2
    kept = {("gateway", name): int(ip) - first for name, ip in used.gateways.items()} | {
        ("service", name): int(ip) - first for name, ip in used.addresses.items()
    }
    slots = _spread(instance, wanted, kept, count)
    address = {key: str(IPv4Address(first + slot)) for key, slot in slots.items()}
    macs = [("mac", name) for name in sorted(set(services))]
    kept_macs = {("mac", name): int(mac.replace(":", "")[2:], 16) for name, mac in used.macs.items() if mac[:2] == "02"}
    return Addresses(
        services={name: ip for (kind, name), ip in address.items() if kind == "service"},
        gateways={name: ip for (kind, name), ip in address.items() if kind == "gateway"},
        macs={name: _mac(slot) for (_, name), slot in _spread(instance, macs, kept_macs, 1 << 40).items()},
    )


def is_free(address: str, subnet: str, gateway: str) -> bool:
    """Return whether a service may have an IPv4 address on a robot's bridge; nothing may that is out of form."""
    try:
        network, wanted = IPv4Network(subnet), IPv4Address(address)
    except ValueError:
        return False
    return wanted in network and address not in (gateway, str(network[0]), str(network[-1]))


def bridge_macs(instance: str, robots: Iterable[str], taken: Iterable[str]) -> dict[str, str]:
    """Return a MAC for the bridge of each robot, none of which is taken: a hash of its name, and the next free one."""
    found: dict[str, str] = {}
    given = set(taken)
    for robot in sorted(set(robots)):
        slot = number("bridge", instance, robot) % (1 << 40)
        while (mac := _mac(slot)) in given:
            slot = (slot + 1) % (1 << 40)
        given.add(mac)
        found[robot] = mac
    return found


def _spread(
    instance: str, wanted: list[tuple[str, str]], kept: Mapping[tuple[str, str], int], count: int
) -> dict[tuple[str, str], int]:
    """Return each (kind, name) a number of its own below `count`: its own, else its hash, else the next free."""
    slot_of: dict[tuple[str, str], int] = {}
    taken: set[int] = set()
    for key in wanted:
        slot = kept.get(key, -1)
        if 0 <= slot < count and slot not in taken:
            slot_of[key] = slot
            taken.add(slot)
    for key in wanted:
        if key not in slot_of:
            slot = number(key[0], instance, key[1]) % count
            while slot in taken:
                slot = (slot + 1) % count
            slot_of[key] = slot
            taken.add(slot)
    return {key: slot_of[key] for key in wanted}


def _mac(slot: int) -> str:
    return ":".join(f"{byte:02x}" for byte in (0x02, *slot.to_bytes(5, "big")))
