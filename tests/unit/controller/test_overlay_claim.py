"""What a plan file says of an encrypted overlay's peers: each robot's key stands beside its own addresses."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest

from srprov.controller.overlay_claim import (
    astray,
    had_twice,
    misled,
    mixed_up,
    record_text,
    told_of_strangers,
    too_many,
)
from srprov.modules.file import FileParams
from srprov.resource import Resource
from tests.bounded import bounded
from tests.resources import resource

UNDERLAYS = {"r1": "192.0.2.1", "r2": "192.0.2.2", "r3": "192.0.2.3"}
ENDS = {"r1": "10.128.0.1", "r2": "10.128.0.2"}


def interfaces(**ends: str) -> list[Resource]:
    return [
        resource(
            "wireguard", "srpw0000000aa", {"instance": "x", "address": end, "port": 20_000, "mtu": 1420}, host=robot
        )
        for robot, end in ends.items()
    ]


def bridges(**ends: str) -> list[Resource]:
    more = {"instance": "x", "source": "", "bridge": "srpb0000000a", "subnet": "10.128.0.0/16", "mtu": 1370}
    return [
        resource("network", "srprov.x", {**more, "gateway": end, "vni": 1, "port": 4789}, host=robot)
        for robot, end in ends.items()
    ]


def peers(*some: tuple[str, str, str], host: str = "r1") -> Resource:
    return resource(
        "wireguard_peers", "srpw0000000aa", {"instance": "x", "peers": [list(one) for one in some]}, host=host
    )


@pytest.mark.parametrize(
    "peer",
    [
        ("r3", "192.0.2.2:20000", ENDS["r2"]),
        ("r3", "192.0.2.3:20000", ENDS["r2"]),
        ("r2", "192.0.2.2:20000", ENDS["r1"]),
        ("r2", "192.0.2.2:20000", "10.128.0.9"),
        ("r2", "192.0.2.3:20000", ENDS["r2"]),
        ("r9", "192.0.2.9:20000", "10.128.0.9"),
    ],
    ids=["another one's key", "its address here", "own address", "no address of it", "elsewhere", "nobody"],
)
def test_no_robot_s_key_is_given_to_the_addresses_of_another_one(peer: tuple[str, str, str]) -> None:
    """Whoever is root on it would be that member to this one, as packets are told apart by keys alone."""
    wants = [*interfaces(**ENDS), changed := peers(peer)]
    assert list(mixed_up([changed], wants, UNDERLAYS)) == [changed]


def test_no_robot_s_interface_has_the_address_of_another_one_s_bridge() -> None:
    """The file gave each of two robots the other one's address: what went to the one's services came to the other."""
    swapped = interfaces(r1=ENDS["r1"], r2="10.128.0.3", r3=ENDS["r2"])
    wants = [*swapped, *bridges(**ENDS, r3="10.128.0.3"), changed := peers(("r3", "192.0.2.3:20000", ENDS["r2"]))]
    assert list(mixed_up([changed], wants, UNDERLAYS)) == [changed]
    wants[:6] = interfaces(r1=ENDS["r1"])  # nor where the file leaves out whose it is
    assert list(mixed_up([changed], wants, UNDERLAYS)) == [changed]


def test_two_robots_with_one_address_are_neither_of_them() -> None:
    wants = [
        *interfaces(r1=ENDS["r1"], r2=ENDS["r2"], r3=ENDS["r2"]),
        changed := peers(("r2", "192.0.2.2:20000", ENDS["r2"])),
    ]
    assert list(mixed_up([changed], wants, UNDERLAYS)) == [changed]


def test_peers_at_their_own_addresses_are_right() -> None:
    wants = [
        *interfaces(**ENDS, r3="10.128.0.3"),
        *bridges(**ENDS, r3="10.128.0.3"),
        right := peers(("r2", "192.0.2.2:20000", ENDS["r2"]), ("r3", "192.0.2.3:20001", "10.128.0.3")),
    ]
    assert list(mixed_up([right], wants, UNDERLAYS)) == []
    assert list(mixed_up([], [*wants, peers(("r3", "192.0.2.2:20000", ENDS["r2"]))], UNDERLAYS)) == []


MACS = {"r1": "02:00:00:00:00:01", "r2": "02:00:00:00:00:02"}


def containers(**peers: str) -> list[Resource]:
    """Return a service on each of two robots; `peers` is robot -> what its service is told of others."""
    return [
        resource(
            "container", f"srprov.x.on-{robot}",
            {"image": "busybox", "instance": "x", "service": f"on-{robot}", "hostname": "", "job": False, "run": {},
             "source": "", "mounts": [], "api": "1.41",
             "network": {"mode": "overlay", "name": "srprov.x", "ip": f"10.128.0.1{robot[1]}", "mac": mac},
             "made_with": {"ROS_STATIC_PEERS": peers[robot]} if robot in peers else {}},
            host=robot,
        )
        for robot, mac in MACS.items()
    ]  # fmt: skip


ALL = "00:00:00:00:00:00"
BRIDGES = {"r1": "02:00:00:00:01:01", "r2": "02:00:00:00:01:02", "r3": "02:00:00:00:01:03"}
NETNS = "srpw0000000aa"


def link(host: str, ends: Mapping[str, str], kind: str = "vxlan", **changed: Any) -> Resource:
    """Return a robot's link as srprov makes it, to robots with these ends; `changed` are fields that are otherwise."""
    others = [other for other in ends if other != host]
    fdb = [[ALL, ends[other]] for other in others] + [[BRIDGES[other], ends[other]] for other in others]
    fdb += [[mac, ends[other]] for other, mac in MACS.items() if other != host]
    said = {"instance": "x", "vni": 1, "local": ends[host], "port": 4789, "bridge": "srpb0000000a", "mtu": 1400}
    if kind == "unit":
        changed = {key: one for key, one in changed.items() if key != "netns"}
        said["link"] = "srpv0000000a"
    name = "srpv0000000a" if kind == "vxlan" else "srprov-x.service"
    return resource(kind, name, {**said, "fdb": fdb, "bridge_mac": BRIDGES[host], **changed}, host=host)


def entries(one: Resource) -> list[list[str]]:
    return [list(entry) for entry in one.params.fdb]


@pytest.mark.parametrize("tunnel", [False, True])
@pytest.mark.parametrize("kind", ["vxlan", "unit"])
def test_a_link_is_the_one_that_follows_from_the_plan_s_robots_and_services(kind: str, tunnel: bool) -> None:
    """Root on another robot would read, or answer, what is a service's; for want of an entry it is sent to all."""
    all_ends = {**ENDS, "r3": "10.128.0.3"}
    ends, netns = (all_ends, NETNS) if tunnel else (UNDERLAYS, "")
    wants = [*containers(), *bridges(**all_ends), *(interfaces(**all_ends) if tunnel else [])]
    wants += [link(host, ends, netns=netns) for host in ("r2", "r3")]
    right = link("r1", ends, kind, netns=netns)
    if kind == "unit" and tunnel:
        return  # no unit restores an encrypted overlay
    fdb = entries(right)
    if kind == "unit":
        wants.append(link("r1", ends, netns=netns))
    assert list(misled([right], [*wants, right], UNDERLAYS)) == []
    changes: dict[str, dict[str, Any]] = {
        f"{mac} is sent to {end}": {"fdb": [[mac, end] if one[0] == mac else one for one in fdb]}
        for mac in (MACS["r2"], BRIDGES["r2"])
        for end in (ends["r3"], "203.0.113.9", (UNDERLAYS if tunnel else all_ends)["r2"])
    }
    changes |= {f"without {one}": {"fdb": [other for other in fdb if other != one]} for one in fdb}
    changes |= {
        "one more robot": {"fdb": [*fdb, [ALL, "203.0.113.9"]]},
        "a MAC of nobody": {"fdb": [*fdb, [OTHER, ends["r3"]]]},
    }
    changes |= {
        "twice": {"fdb": [*fdb, fdb[0]]},
        "from elsewhere": {"local": "203.0.113.9"},
        "any bridge": {"bridge_mac": ""},
    }
    if kind == "vxlan":
        changes["the other way"] = {"netns": "" if tunnel else NETNS}
    for what, changed in changes.items():
        wrong = link("r1", ends, kind, **{"netns": netns, **changed})
        assert list(misled([wrong], [*wants, wrong], UNDERLAYS)) == [wrong], what
        assert wrong in list(astray([wrong], [*wants, wrong], UNDERLAYS)), what


OTHER = "02:00:00:00:00:77"


def test_no_two_bridges_and_no_bridge_and_service_have_one_mac() -> None:
    """What is for the services in the network of the one robot would come to the other one."""
    wants = [*containers(), *bridges(**ENDS, r3="10.128.0.3")]
    links = [link(host, UNDERLAYS) for host in ("r1", "r2", "r3")]
    assert list(had_twice([*wants, *links])) == []
    for mac, who in (
        (BRIDGES["r2"], "the bridge on r1 and the bridge on r2"),
        (MACS["r2"], "on-r2 and the bridge on r1"),
    ):
        links[0] = link("r1", UNDERLAYS, bridge_mac=mac)
        assert list(had_twice([*wants, *links])) == [f"{mac}: {who} would both have it"]


@pytest.mark.parametrize("told", ["203.0.113.66;10.128.0.12", "10.128.0.1", "elsewhere", ""])
def test_no_container_is_told_of_peers_beyond_its_overlay(told: str) -> None:
    right, strange = containers(r1="10.128.0.11;10.128.0.12"), containers(r1=told)
    assert list(told_of_strangers(right, [*right, *bridges(**ENDS)])) == []
    assert list(told_of_strangers(strange, [*strange, *bridges(**ENDS)])) == [strange[0]]
    assert list(astray(strange, [*strange, *bridges(**ENDS)], UNDERLAYS)) == [strange[0]]
    assert list(told_of_strangers(right, right)) == [right[0]], "it is on none"


def record(host: str, content: str = "{}") -> Resource:
    return resource("file", "/var/lib/srprov/x/placement.json", {"content": content}, host=host)


def test_a_robot_has_one_network_and_one_record_before_anything_is_compared() -> None:
    """8000 networks and links of one robot took 38 s, as did a few thousand records that share 30 MiB."""
    assert list(too_many([*bridges(**ENDS), *interfaces(**ENDS), record("r1"), record("r2")])) == []
    assert list(too_many([*bridges(**ENDS), *bridges(r1=ENDS["r1"]), record("r1"), record("r1")])) == [
        "r1: it would have 2 of what a plan has once for each robot: a network",
        "r1: it would have 2 of what a plan has once for each robot: a record of the placement",
    ]
    assert list(too_many([record("r1", " " * ((4 << 20) + 1))])) == [
        "r1: its record of the placement is longer than 4 MiB"
    ]


def test_links_that_say_little_are_compared_with_little() -> None:
    robots = {f"r{at}": f"10.128.{at // 200}.{at % 200 + 1}" for at in range(3000)}
    more = {"instance": "x", "vni": 1, "local": "10.0.0.1", "port": 4789, "bridge": "x", "mtu": 1400, "fdb": []}
    links = [resource("vxlan", "srpv0000000a", more, host=robot) for robot in robots]
    wants = [*bridges(**robots), *links]
    assert bounded(lambda: len(list(misled(links, wants, {}))), cpu_s=1) == len(links)


def test_robots_that_share_a_record_have_it_read_once() -> None:
    blob = b'{"robots": {}}'
    texts = {id(record_text(FileParams(blob=blob))) for _ in range(3)}
    assert len(texts) == 1
