"""The identity of an instance's overlay: VNI, UDP port, link names, Docker network and subnet.

Takes the instance id, the EDF's settings and all robots as they are; gives an `InstanceIdentity` that stays the same
for the instance's life. Pure: the controller alone decides, robots agree on nothing at run time.

Source: VXLAN, RFC 7348 (a VNI has 24 bits). Who decides, first hit wins: the EDF; what the instance uses already; a
hash, and the next candidate while that is taken on any robot. The hash is `number(kind, instance, name)`, documented in
docs/network.md.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from ipaddress import IPv4Network
from typing import TypeGuard, TypeVar

import msgspec

from srprov.codes import Code
from srprov.definitions.model import NetworkSettings
from srprov.errors import UsageError
from srprov.facts.model import Snapshot
from srprov.network.claims import Claims
from srprov.network.foreign import LARGEST, ForeignUse, Ranges, foreign_uses, overlap, to_network
from srprov.network.record import PlacementRecord

POOL = IPv4Network("10.128.0.0/9")
"""Where subnets are taken from: the upper half of 10/8, which Docker's own pools leave alone."""
PREFIX = 20
"""4094 addresses per instance, 2048 instances."""
SMALLEST = 29
"""Longest prefix that an overlay's subnet may have: six addresses."""
_ALIAS = "srprov:"
"""Before the instance id, in the alias of a link that is ours."""
VNI_FIRST, VNI_LAST = 0x100000, 0xFFFFFF
"""Above what people number by hand, and what other overlays count up to from 1."""

_T = TypeVar("_T", int, IPv4Network)


class InstanceIdentity(msgspec.Struct, frozen=True, kw_only=True):
    """What tells one instance's overlay from all others."""

    instance: str
    vni: int
    port: int
    bridge: str
    """At most 15 characters, as the kernel wants."""
    link: str
    """The VXLAN port of that bridge."""
    network: str
    """The Docker network's name."""
    subnet: IPv4Network


def number(kind: str, instance: str, name: str = "") -> int:
    """Return the documented hash: the first 8 bytes, big-endian, of SHA-256 of `srprov/KIND/INSTANCE/NAME` in UTF-8."""
    return int.from_bytes(hashlib.sha256(f"srprov/{kind}/{instance}/{name}".encode()).digest()[:8], "big")


def link_names(instance: str) -> tuple[str, str]:
    """Return the names of an instance's bridge and of its VXLAN link, e.g. `srpb0a1b2c3d` and `srpv0a1b2c3d`."""
    digits = f"{number('link', instance) >> 32:08x}"
    return f"srpb{digits}", f"srpv{digits}"


def tunnel_name(instance: str) -> str:
    """Return the name of the network namespace of an encrypted overlay; its interfaces have a letter more."""
    return f"srpw{number('link', instance) >> 32:08x}"


def tunnel_links(instance: str) -> tuple[str, str]:
    """Return the names of its interfaces: one takes the place of the other when keys change."""
    return f"{tunnel_name(instance)}a", f"{tunnel_name(instance)}b"


def network_name(instance: str) -> str:
    """Return the name of an instance's Docker network."""
    return f"srprov.{instance}"


def is_for_overlays(subnet: str) -> bool:
    """Return whether a subnet lies within those that srprov itself chooses from, and is no larger than they are."""
    return _is_ours(to_network(subnet))


def identify(
    instance: str,
    settings: NetworkSettings,
    snapshot: Snapshot,
    record: PlacementRecord | None = None,
    members: Collection[str] | None = None,
) -> InstanceIdentity:
    """Return the identity of an instance's overlay.

    Args:
        instance: The instance id.
        settings: What the EDF asks for.
        snapshot: All robots as they are; what others use is avoided, also where this instance runs nothing (yet).
        record: The last placement of this instance, if any robot holds one.
        members: The robots that the overlay is to be on; None: all.

    Raises:
        UsageError: A wish that makes no sense or that something else on a robot has, or nothing is left to choose.
    """
    bridge, link = link_names(instance)
    check_names(instance, snapshot)
    on = snapshot.facts.keys() if members is None else snapshot.facts.keys() & {*members}
    _check_port(settings, snapshot, sorted(on), link)
    claims = Claims(instance, (bridge, link), snapshot, sorted(on))
    ours, vni = _in_use(claims, settings.port, record or PlacementRecord())
    foreign = tuple(foreign_uses(instance, (bridge, link), snapshot, ours))
    return InstanceIdentity(
        instance=instance,
        vni=_vni(instance, settings, vni, foreign),
        port=settings.port,
        bridge=bridge,
        link=link,
        network=network_name(instance),
        subnet=_subnet(instance, settings, ours, foreign),
    )


def _check_port(settings: NetworkSettings, snapshot: Snapshot, members: Iterable[str], own: str) -> None:
    """Refuse a port on which a link of others takes all VNIs (`external`), which tools show as the VNI 0."""
    for robot in members if settings.encryption == "none" else ():
        for link in snapshot.facts[robot].links:
            if (link.kind, link.vni, link.port) == ("vxlan", 0, settings.port) and link.name != own:
                message = f"network.port {link.port} is that of link {link.name} on {robot}, which takes all VNIs"
                raise UsageError(message, hint="give network.port another one", code=Code.VNI)


def _vni(instance: str, settings: NetworkSettings, used: int, foreign: Iterable[ForeignUse]) -> int:
    """Return the VNI; two VXLANs of one robot may share it only on different ports."""
    taken = {use.vni: use.where for use in foreign if use.vni and use.port in (0, settings.port)}
    if settings.vni is not None:
        hint = "leave it out to have one chosen"
        if not _is_vni(settings.vni):
            raise UsageError(f"network.vni {settings.vni} is not in 1..{VNI_LAST}", hint=hint, code=Code.VNI)
        if settings.vni in taken:
            raise UsageError(f"network.vni {settings.vni} is used by {taken[settings.vni]}", hint=hint, code=Code.VNI)
        return settings.vni
    if used:
        return used
    count = VNI_LAST - VNI_FIRST + 1
    start = number("vni", instance) % count
    return next(vni for i in range(count) if (vni := VNI_FIRST + (start + i) % count) not in taken)


def _subnet(
    instance: str, settings: NetworkSettings, used: IPv4Network | None, foreign: tuple[ForeignUse, ...]
) -> IPv4Network:
    """Return the subnet; nothing on any robot that is not ours may overlap it."""
    if settings.subnet is not None:
        wanted = to_network(settings.subnet)
        if not _fits(wanted):
            hint = "write it as 10.200.0.0/20, or leave it out to have one chosen"
            raise UsageError(
                f"network.subnet '{settings.subnet}' is not an IPv4 network of size /{LARGEST} to /{SMALLEST}",
                hint=hint,
                code=Code.SUBNET,
            )
        conflict = overlap(wanted, foreign) if wanted != used else None
        if conflict:
            hint = "choose another, or leave it out to have one chosen"
            raise UsageError(f"network.subnet {wanted} overlaps {conflict.where}", hint=hint, code=Code.SUBNET)
        return wanted
    if used is not None and _is_ours(used):  # another one was an EDF's wish, or is a robot's lie
        return used
    count = 1 << (PREFIX - POOL.prefixlen)
    start = number("subnet", instance) % count
    taken = Ranges(use.subnet for use in foreign)
    for i in range(count):
        base = int(POOL.network_address) + ((start + i) % count << (32 - PREFIX))
        candidate = IPv4Network((base, PREFIX))
        if not taken.meet(candidate):
            return candidate
    raise UsageError(
        f"no /{PREFIX} of {POOL} is free on all robots", hint="name one as network.subnet in the EDF", code=Code.SUBNET
    )


def _in_use(claims: Claims, port: int, record: PlacementRecord) -> tuple[IPv4Network | None, int]:
    """Return the subnet and VNI that the instance has now: by most of its Docker networks, else by the last placement.

    What robots say is untrusted: a subnet that would swallow an address that some robot has or relies on, and a VNI
    out of range, are not used. Nor is what a robot that gets the overlay does not have yet, and says that others have
    there: another robot's word would lead its packets into the overlay, or let that robot send into another one.
    """
    away, subnets, vnis = claims.lifelines(), claims.subnets(), claims.vnis()
    if not claims.made:
        subnets, vnis = {record.subnet: 1}, {record.vni: 1}
    networks = Counter[IPv4Network]()
    for text, count in subnets.items():
        if _fits(network := to_network(text)) and not away.meet(network) and not claims.routed_elsewhere(network):
            networks[network] += count
    numbers = {one: count for one, count in vnis.items() if _is_vni(one) and not claims.has_vni(one, port)}
    return _most_frequent(networks, to_network(record.subnet)), _most_frequent(numbers, record.vni) or 0


def _most_frequent(counts: Mapping[_T, int], before: _T | None) -> _T | None:
    """Return the most frequent value, of several that of the last placement, else the smallest.

    Robots differ only when a change was interrupted, or one of them lies.
    """
    return min(counts, key=lambda value: (-counts[value], value != before, value), default=None)


def check_names(instance: str, snapshot: Snapshot) -> None:
    """Refuse when something on a robot has a name of ours and is another instance's.

    The names have 32 bits of hash, so that does not happen by itself; but who looks for it finds an instance's name
    with those of another one within minutes, and would be let into that one's overlay.

    Raises:
        UsageError: Names it.
    """
    names = (*link_names(instance), tunnel_name(instance), *tunnel_links(instance))
    for robot, facts in sorted(snapshot.facts.items()):
        for link in facts.links:
            if link.name in names and link.alias not in ("", _ALIAS + instance):
                raise _anothers(f"link {link.name}", robot, link.alias.removeprefix(_ALIAS))
    for robot, items in sorted(snapshot.observed.items()):
        for one in items:
            # a bridge has no alias, and is there without its link when the robot was restarted
            if one.instance not in ("", instance) and (one.name in names or one.state.get("bridge") in names):
                raise _anothers(f"{one.module} {one.name}", robot, one.instance)


def _anothers(what: str, robot: str, whose: str) -> UsageError:
    hint = "choose another --instance, or give the experiment another name"
    why = f"{what} on {robot} belongs to '{whose}', whose links would have the same names"
    return UsageError(why, hint=hint, code=Code.VNI)


def _is_vni(number: int) -> bool:
    return 0 < number <= VNI_LAST


def _is_ours(network: IPv4Network | None) -> bool:
    return network is not None and network.subnet_of(POOL) and network.prefixlen >= PREFIX


def _fits(network: IPv4Network | None) -> TypeGuard[IPv4Network]:
    """Return whether a network can be an overlay's: no slip of the pen for half the Internet, and not too small."""
    return network is not None and LARGEST <= network.prefixlen <= SMALLEST
