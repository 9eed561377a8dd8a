"""What a plan file says of overlays: where packets go, who may send, and what of it does not fit together. Pure."""

from __future__ import annotations

import functools
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

from srprov.codes import Code
from srprov.controller.robot_files import is_record_path
from srprov.errors import RefusedError
from srprov.facts.placements import MOST_OF_RECORDS
from srprov.modules.container_params import ContainerParams
from srprov.modules.file import FileParams
from srprov.modules.network import NetworkParams
from srprov.modules.vxlan import VxlanParams
from srprov.modules.vxlan_fdb import FLOOD
from srprov.modules.vxlan_filter import VxlanFilterParams
from srprov.modules.wireguard import WireguardParams
from srprov.modules.wireguard_peers import WireguardPeersParams, host_of
from srprov.network.addresses import is_free
from srprov.network.record import read_record
from srprov.planning.planfile import PlanFile
from srprov.resource import Resource
from srprov.untrusted import json_or_none, mapping

_ONE_EACH: dict[type, str] = {NetworkParams: "network", VxlanParams: "link", VxlanFilterParams: "link's filter"}


def vteps_of(want: Resource) -> Collection[str]:
    """Return where packets go, or come from, by what a resource says: a link, its filter, or a placement's record."""
    if isinstance(want.params, VxlanParams | VxlanFilterParams | WireguardPeersParams):
        return want.params.vteps
    if isinstance(want.params, FileParams) and is_record_path(want.name):
        return _vteps_of_record(record_text(want.params))
    return ()


def record_text(params: FileParams) -> str:
    """Return what a placement's record says, as one text for all robots that have the same bytes."""
    return _decoded(params.blob) if params.blob is not None else params.text


@functools.lru_cache(maxsize=4)  # all robots have one
def _decoded(blob: bytes) -> str:
    return blob.decode("utf-8", "replace")


@functools.lru_cache(maxsize=4)
def _vteps_of_record(text: str) -> Collection[str]:
    record = read_record(mapping(json_or_none(text)))
    return tuple(record.vteps.values()) if record else ()


def too_many(wants: Sequence[Resource]) -> Iterator[str]:
    """Say which robot has more of an overlay than a plan makes, or a record that is longer than one is read.

    Everything of an overlay is compared with all of it: this comes first.
    """
    found = Counter[tuple[str, str]]()
    longest = dict[str, int]()
    for want in wants:
        what = _ONE_EACH.get(type(want.params), "")
        if isinstance(want.params, FileParams) and is_record_path(want.name):
            what, length = "record of the placement", len(want.params.content or want.params.blob or b"")
            longest[want.host] = max(length, longest.get(want.host, 0))
        if what:
            found[want.host, what] += 1
    for (robot, what), count in sorted(found.items()):
        if count > 1:
            yield f"{robot}: it would have {count} of what a plan has once for each robot: a {what}"
    for robot, length in sorted(longest.items()):
        if length > MOST_OF_RECORDS:
            yield f"{robot}: its record of the placement is longer than {MOST_OF_RECORDS >> 20} MiB"


def wrong_link(
    want: Resource, link: VxlanParams | VxlanFilterParams, networks: Sequence[NetworkParams]
) -> Iterator[str]:
    """Say what of a link or its filter does not fit to the networks of its robot."""
    if (link.vni, link.port) not in {(one.vni, one.port) for one in networks}:
        yield f"{want.id}: its VNI and port are not those of the network there"
    if isinstance(link, VxlanFilterParams):
        return
    own = [one for one in networks if one.bridge == link.bridge]
    if not all(any(is_free(each, one.subnet, one.gateway) for one in own) for each in link.addresses):
        yield f"{want.id}: its addresses are not such as services on the network there may have"


def astray(steps: Sequence[Resource], wants: Sequence[Resource], underlays: Mapping[str, str]) -> Iterator[Resource]:
    """Return what would lead packets to where they are not for, or let in whom they are not from.

    Args:
        steps: What is not there yet.
        wants: All that the plan wants, these too.
        underlays: Robot -> its underlay address.
    """
    yield from open_links(wants)
    yield from mixed_up(steps, wants, underlays)
    yield from misled(steps, wants, underlays)
    yield from told_of_strangers(steps, wants)


def open_links(wants: Sequence[Resource]) -> Iterator[Resource]:
    """Return the links that others than the robots they send to may send into: srprov's own have a filter."""
    filters = {(one.host, one.name): {*one.params.vteps} for one in wants if isinstance(one.params, VxlanFilterParams)}
    for want in wants:
        link = want.params
        if want.module != "vxlan" or link.netns:
            continue
        if filters.get((want.host, want.name)) != {*link.vteps}:
            yield want


def underlays_of(saved: PlanFile) -> dict[str, str]:
    """Return robot -> its underlay address, of those that an overlay of a plan may have.

    A robot of which the placement says nothing is none of them, whatever else of it is in the file.
    """
    members = saved.fingerprints.keys() & {*saved.plan.assignment.values()}
    found = {one: mapping(mapping(saved.fingerprints[one]).get("underlay")).get("address") for one in members}
    # one with a scope reaches no other robot, and no overlay has it
    return {robot: "" if "%" in one else one for robot, one in found.items() if isinstance(one, str)}


def mixed_up(
    steps: Sequence[Resource], wants: Sequence[Resource], underlays: Mapping[str, str]
) -> Iterator[Resource]:  # fmt: skip
    """Return the peers of encrypted overlays of which one gets the key of another robot than its addresses are of.

    That one would be sent, and could send, what is the other's. `steps` are those of `wants` that are not there yet.
    Each robot that is a peer has its interface among those.
    """
    ends: dict[str, set[str]] = {}
    for want in wants:
        if isinstance(want.params, WireguardParams):
            ends.setdefault(want.host, set()).add(want.params.address)
        elif isinstance(want.params, NetworkParams):  # a robot's address in the tunnel is that of its bridge
            ends.setdefault(want.host, set()).add(want.params.gateway)
    whose: dict[str, set[str]] = {}
    for robot, some in ends.items():
        for end in some:
            whose.setdefault(end, set()).add(robot)
    for want in steps:
        if isinstance(want.params, WireguardPeersParams) and not all(
            underlays.get(robot) == host_of(endpoint) and whose.get(end) == {robot}
            for robot, endpoint, end in want.params.peers
        ):
            yield want


def misled(steps: Iterable[Resource], wants: Sequence[Resource], underlays: Mapping[str, str]) -> Iterator[Resource]:
    """Return the links that are not those of the plan's robots and services, and units that restore such.

    An entry more leads what is for one robot's services to another one; for want of one, it is sent to all robots. All
    that srprov's own links have follows from who is where: so whatever else a link has is none of its own.
    """
    members = {want.host: want.params for want in wants if isinstance(want.params, NetworkParams)}
    tunnels = {want.host for want in wants if isinstance(want.params, WireguardParams)}
    ends = {robot: one.gateway for robot, one in members.items()} if tunnels else underlays
    homes = [(link.bridge_mac, want.host) for want in wants if type(link := want.params) is VxlanParams]
    homes += [(one.network.mac, want.host) for want in wants
              if isinstance(one := want.params, ContainerParams) and one.network.mac]  # fmt: skip
    there = Counter(at for _, at in homes if at in members)
    entries = there.total()
    for want in steps:
        if not isinstance(link := want.params, VxlanParams):
            continue
        # as many as there are others and services there: who has written less is not compared with all of them
        if len(link.fdb) != len(members) - (want.host in members) + entries - there[want.host]:
            yield want
            continue
        others = {robot: ends.get(robot, "") for robot in members if robot != want.host}
        fdb = {(FLOOD, end) for end in others.values()} | {(mac, others[at]) for mac, at in homes if at in others}
        whole = len(fdb) == len(others) + sum(at in others for _, at in homes)
        right = {*link.fdb} == fdb and len(link.fdb) == len(fdb) and all(map(all, fdb))
        tunnel = bool(link.netns) == bool(tunnels) == (want.host in tunnels)
        if not (whole and right and tunnel and link.local == ends.get(want.host) and link.bridge_mac):
            yield want


def told_of_strangers(steps: Iterable[Resource], wants: Sequence[Resource]) -> Iterator[Resource]:
    """Return the containers that are told of peers elsewhere than on the overlay of their robot."""
    overlays = {want.host: want.params for want in wants if isinstance(want.params, NetworkParams)}
    for want in steps:
        if isinstance(want.params, ContainerParams) and want.params.made_with:
            own = overlays.get(want.host)
            peers = [one for value in want.params.made_with.values() for one in value.split(";")]
            if own is None or not all(is_free(one, own.subnet, own.gateway) for one in peers):
                yield want


def had_twice(wants: Sequence[Resource]) -> Iterator[str]:
    """Say who has one address or MAC with another one: what is sent to the one of them would come to the other."""
    found: dict[str, set[str]] = {}
    both = {
        (want.host, want.params.network.ip): want.params.service
        for want in wants
        if isinstance(want.params, ContainerParams) and want.params.network.mode == "both"
    }
    for want in wants:
        if isinstance(want.params, ContainerParams):
            for end in filter(None, (want.params.network.ip, want.params.network.mac)):
                found.setdefault(end, set()).add(want.params.service)
        elif isinstance(want.params, NetworkParams):
            found.setdefault(want.params.gateway, set()).add(f"the bridge on {want.host}")
        elif isinstance(want.params, VxlanParams):
            found.setdefault(want.params.bridge_mac, set()).add(f"the bridge on {want.host}")
            for end in want.params.addresses:  # of services that are in their robot's own network
                found.setdefault(end, set()).add(both.get((want.host, end), f"the bridge on {want.host}"))
    for end, some in sorted(found.items()):
        if len(some) > 1:
            yield f"{end}: {' and '.join(sorted(some))} would both have it"


def check_underlay(saved: PlanFile, wants: Sequence[Resource], live: Mapping[str, str]) -> None:
    """Refuse packets to where only a file of elsewhere says that a robot is.

    `wants` is all that it wants; `live` is robot -> its underlay address, of those that answer.

    Raises:
        RefusedError: Links would send to an address of a robot that does not answer, or the record would name it.
    """
    told = {robot: address for robot, address in underlays_of(saved).items() if live.get(robot) != address}
    used = {vtep for want in wants for vtep in vteps_of(want)}
    if strange := sorted(f"{address} for {robot}" for robot, address in told.items() if address in used):
        raise RefusedError(
            f"packets would go to {', '.join(strange)}, of which only this file says that it is there",
            hint="apply it when that robot answers, or plan the EDF here",
            code=Code.STRANGE_PLAN,
        )
