"""The overlay of one instance: who is where, and what every robot must know to reach everybody.

Takes the experiment, where its services run and all robots as they are; gives an Overlay. Pure.

Source: VXLAN (RFC 7348) with head-end replication: each robot has, per other member, one all-zero forwarding entry that
carries broadcast and multicast, and one entry per remote service. What VXLAN adds to a packet is 50 bytes over IPv4
(inner Ethernet 14, VXLAN 8, UDP 8, IP 20) and 70 over IPv6.
"""

from __future__ import annotations

from collections.abc import Mapping
from ipaddress import ip_address

from msgspec.structs import replace

from srprov.codes import Code
from srprov.definitions.model import Experiment, NetworkSettings
from srprov.errors import UsageError
from srprov.facts.model import Snapshot
from srprov.network.addresses import allocate, bridge_macs
from srprov.network.foreign import lost_on_the_way
from srprov.network.identity import identify
from srprov.network.model import Overlay, Tunnel
from srprov.network.record import PlacementRecord, read_record
from srprov.network.tunnel import OVERHEAD as ENCRYPTED
from srprov.network.tunnel import tunnel_of

OVERHEAD = {4: 50, 6: 70}
"""Bytes that VXLAN adds, by IP version of the underlay."""
_LEAST_MTU = 576
"""bytes; what the EDF's schema allows. A record that says less is not believed."""
ON_OVERLAY = ("overlay", "both")
"""Network modes of services that have an address there."""


def layout(
    experiment: Experiment, placed: Mapping[str, str], snapshot: Snapshot, *, instance: str = "", rotate: bool = False
) -> Overlay:
    """Return the overlay for a placement.

    Args:
        experiment: Whose services, network settings and name.
        placed: Service -> robot, also robots that cannot be reached and keep their services.
        snapshot: All robots as they are, with the placement records they hold.
        instance: The instance id; the experiment's name when empty.
        rotate: An encrypted overlay gets new keys.

    Raises:
        UsageError: A wish that can't be met, or robots that have no address, the same one, or different IP versions.
    """
    instance = instance or experiment.name
    record = read_record(snapshot.placements.get(instance))
    underlays = _underlays(placed, snapshot, record)
    on_overlay = sorted(name for name in placed if experiment.services[name].network in ON_OVERLAY)
    members = sorted({placed[name] for name in on_overlay})
    vteps = {robot: underlays[robot] for robot in members if robot in underlays}
    if not on_overlay:
        return _named(instance, experiment, placed, underlays, {})
    _check_vteps(members, vteps, snapshot, persist=experiment.network.persist)
    _check_ways(instance, vteps, snapshot)
    identity = identify(instance, experiment.network, snapshot, record, members)
    given = allocate(instance, identity.subnet, on_overlay, members, record)
    macs, bridges = _macs(instance, experiment, given.macs, vteps)
    plain = replace(
        _named(instance, experiment, placed, underlays, given.services),
        vni=identity.vni,
        port=identity.port,
        bridge=identity.bridge,
        link=identity.link,
        network=identity.network,
        subnet=str(identity.subnet),
        mtu=_mtu(experiment.network, vteps, snapshot, record),
        addresses=given.services,
        macs=macs,
        bridge_macs=bridges,
        gateways=given.gateways,
        vteps=vteps,
    )
    tunnel = tunnel_of(instance, experiment, vteps, snapshot, mtu=plain.mtu + OVERHEAD[4], rotate=rotate)
    return _joined(plain, placed, tunnel)


def _joined(plain: Overlay, placed: Mapping[str, str], tunnel: Tunnel | None) -> Overlay:
    """Return an overlay with its robots' forwarding entries: to each other's underlay address, or through a tunnel."""
    ends = {robot: plain.gateways[robot] for robot in plain.vteps} if tunnel else plain.vteps
    flood = {robot: tuple(sorted(end for other, end in ends.items() if other != robot)) for robot in ends}
    fdb = {robot: _entries(robot, placed, plain.macs, plain.bridge_macs, ends) for robot in ends}
    return replace(plain, flood=flood, fdb=fdb, tunnel=tunnel)


def _underlays(placed: Mapping[str, str], snapshot: Snapshot, record: PlacementRecord | None) -> dict[str, str]:
    """Return each robot's underlay address: as it says itself, or for one out of reach as the last placement says."""
    there = {robot: facts.underlay_address for robot, facts in snapshot.facts.items()}
    # another robot may have that address by now: it is sent nothing that is for one that is away
    known = {robot: vtep for robot, vtep in (record.vteps if record else {}).items() if vtep not in there.values()}
    known |= there
    # facts may come from a file; an address with a scope (and whatever text that is) reaches no other robot
    return {
        robot: known[robot] for robot in sorted(set(placed.values())) if known.get(robot) and "%" not in known[robot]
    }


def _check_vteps(members: list[str], vteps: Mapping[str, str], snapshot: Snapshot, *, persist: bool) -> None:
    """Refuse what cannot be one VXLAN segment, or not restore it."""
    if persist:
        _check_systemd(members, snapshot)
    hint = "set srprov_underlay in the inventory to the interface or address that the other robots reach"
    for robot in members:
        if robot in snapshot.facts and robot not in vteps:
            raise UsageError(f"{robot} has no address that other robots reach", hint=hint, code=Code.UNDERLAY)
    owner: dict[str, str] = {}
    for robot, vtep in vteps.items():
        if vtep in owner:
            raise UsageError(
                f"{owner[vtep]} and {robot} have the same underlay address {vtep}", hint=hint, code=Code.UNDERLAY
            )
        owner[vtep] = robot
    versions = {ip_address(vtep).version: robot for robot, vtep in vteps.items()}
    if len(versions) > 1:
        raise UsageError(
            f"{versions[4]} has an IPv4 underlay address, {versions[6]} an IPv6 one", hint=hint, code=Code.UNDERLAY
        )


def _check_ways(instance: str, vteps: Mapping[str, str], snapshot: Snapshot) -> None:
    """Refuse what would go to containers of another instance: any of them may take an address of their subnet."""
    if lost := lost_on_the_way(vteps, instance, snapshot):
        robot, peer, use = lost
        raise UsageError(
            f"{robot} would send what is for {peer} into {use.where}, whose subnet {use.subnet} has that address",
            hint="destroy that instance, or give it another network.subnet",
            code=Code.SUBNET,
        )


def _check_systemd(members: list[str], snapshot: Snapshot) -> None:
    """Refuse robots on which nothing would run a unit."""
    lacking = [robot for robot in members if robot in snapshot.facts and not snapshot.facts[robot].systemd]
    if lacking:
        message = f"network.persist needs systemd, which does not run on {', '.join(lacking)}"
        raise UsageError(
            message, hint="leave network.persist out, or place the services elsewhere", code=Code.NETWORK_ABILITY
        )


def _mtu(
    settings: NetworkSettings, vteps: Mapping[str, str], snapshot: Snapshot, record: PlacementRecord | None
) -> int:
    """Return the overlay's MTU: what the EDF says, else what the smallest underlay MTU leaves, and no more than it has.

    For another MTU every container is made anew. So it is not raised when its narrowest robot leaves, or is away.
    """
    # inside of a tunnel VXLAN's own packets are of IPv4
    added = {ip: OVERHEAD[4] + more for ip, more in ENCRYPTED.items()} if settings.encryption != "none" else OVERHEAD
    possible = {
        robot: snapshot.facts[robot].underlay_mtu - added[ip_address(vtep).version]
        for robot, vtep in vteps.items()
        if robot in snapshot.facts
    }
    if settings.mtu is not None:
        _check_mtu(settings.mtu, possible)
        return settings.mtu
    _check_narrowest(possible)
    remembered = [record.mtu] if record and record.mtu >= _LEAST_MTU else []
    return min([*possible.values(), *remembered], default=1500 - max(added.values()))


def _check_mtu(wish: int, possible: Mapping[str, int]) -> None:
    narrow = min(possible, key=lambda robot: (possible[robot], robot), default="")
    if narrow and wish > possible[narrow]:
        message = f"network.mtu {wish} is more than {narrow}'s underlay leaves: {possible[narrow]}"
        raise UsageError(message, hint="lower it, or leave it out", code=Code.NETWORK_ABILITY)


def _check_narrowest(possible: Mapping[str, int]) -> None:
    """Refuse what would leave nobody a network, by the word of one robot."""
    narrow = min(possible, key=lambda robot: (possible[robot], robot), default="")
    if narrow and possible[narrow] < _LEAST_MTU:
        left = f"{possible[narrow]} bytes for a packet of the overlay, and {_LEAST_MTU} are the least"
        hint = "raise the MTU of its link, or place its services on other robots"
        raise UsageError(f"{narrow}'s underlay leaves {left}", hint=hint, code=Code.NETWORK_ABILITY)


def _macs(
    instance: str,
    experiment: Experiment,
    given: Mapping[str, str],
    vteps: Mapping[str, str],
) -> tuple[dict[str, str], dict[str, str]]:
    """Return the MACs of services with an interface of their own, and of all members' bridges."""
    macs = {name: mac for name, mac in given.items() if experiment.services[name].network == "overlay"}
    return macs, bridge_macs(instance, vteps.keys(), macs.values())


def _entries(
    robot: str,
    placed: Mapping[str, str],
    macs: Mapping[str, str],
    bridges: Mapping[str, str],
    vteps: Mapping[str, str],
) -> tuple[tuple[str, str], ...]:
    remote = {name for name in macs if placed[name] != robot and placed[name] in vteps}
    found = [(macs[name], vteps[placed[name]]) for name in remote]
    found += [(mac, vteps[other]) for other, mac in bridges.items() if other != robot]
    return tuple(sorted(found))


def _named(
    instance: str, experiment: Experiment, placed: Mapping[str, str], underlays: Mapping[str, str],
    addresses: Mapping[str, str],
) -> Overlay:  # fmt: skip
    """Return the names alone; a service on the host's network answers at its robot's underlay address."""
    names = dict(addresses)
    for name, robot in placed.items():
        if experiment.services[name].network == "host" and robot in underlays:
            names[name] = underlays[robot]
    names = dict(sorted(names.items()))
    return Overlay(instance=instance, underlays=underlays, names=names, aliases=_aliases(experiment, names))


def _aliases(experiment: Experiment, names: Mapping[str, str]) -> dict[str, tuple[str, ...]]:
    """Return the name in the EDF -> the addresses of all its instances."""
    found: dict[str, list[str]] = {}
    for name, address in names.items():
        if experiment.services[name].instance_of:
            found.setdefault(experiment.services[name].instance_of, []).append(address)
    return {name: tuple(dict.fromkeys(addresses)) for name, addresses in sorted(found.items())}
