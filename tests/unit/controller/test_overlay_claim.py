"""What a plan file says of an encrypted overlay's peers: each robot's key stands beside its own addresses."""

from __future__ import annotations

import pytest

from srprov.controller.overlay_claim import astray, misled, mixed_up, told_of_strangers
from srprov.resource import Resource
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


def link(
    *fdb: tuple[str, str], kind: str = "vxlan", netns: str = "", bridge_mac: str = "", host: str = "r1"
) -> Resource:
    more = {"link": "srpv0000000a"} if kind == "unit" else {"netns": netns}
    said = {"instance": "x", "vni": 1, "local": UNDERLAYS[host], "port": 4789, "bridge": "srpb0000000a", "mtu": 1400}
    name = "srpv0000000a" if kind == "vxlan" else "srprov-x.service"
    return resource(
        kind, name, {**said, "fdb": [list(one) for one in fdb], "bridge_mac": bridge_mac, **more}, host=host
    )


@pytest.mark.parametrize(
    ("kind", "netns", "right", "wrong"),
    [
        ("vxlan", "", UNDERLAYS["r2"], UNDERLAYS["r3"]),
        ("unit", "", UNDERLAYS["r2"], UNDERLAYS["r3"]),
        ("vxlan", "srpw0000000aa", ENDS["r2"], "10.128.0.3"),
        ("vxlan", "srpw0000000aa", ENDS["r2"], UNDERLAYS["r2"]),
    ],
)
def test_no_packet_for_a_service_goes_to_another_robot(
    kind: str, netns: str, right: str, wrong: str
) -> None:  # fmt: skip
    """Root on that one would read, and answer, what is the service's."""
    # the bridge of another robot that has its MAC changes nothing
    wants = [*containers(), *bridges(**ENDS, r3="10.128.0.3"), link(bridge_mac=MACS["r2"], host="r3")]
    flood = ("00:00:00:00:00:00", right)
    for end, found in ((right, False), (wrong, True)):
        step = link(flood, (MACS["r2"], end), kind=kind, netns=netns)
        assert list(misled([step], [*wants, step], UNDERLAYS)) == [step] * found
        # without a filter, one in the robot's own network is open besides
        assert (step in list(astray([step], [*wants, step], UNDERLAYS))) is (found or (kind, netns) == ("vxlan", ""))


def test_no_packet_for_a_robot_s_own_services_goes_to_another_one() -> None:
    wants = [*containers(), *bridges(**ENDS), link(bridge_mac="02:00:00:00:00:09", host="r2")]
    for end, found in ((UNDERLAYS["r2"], False), (UNDERLAYS["r3"], True)):
        step = link(("02:00:00:00:00:09", end))
        assert list(misled([step], [*wants, step], UNDERLAYS)) == [step] * found
    unknown = link(("02:00:00:00:00:77", UNDERLAYS["r3"]))
    assert list(misled([unknown], wants, UNDERLAYS)) == []  # of a robot that is out of reach


@pytest.mark.parametrize("told", ["203.0.113.66;10.128.0.12", "10.128.0.1", "elsewhere", ""])
def test_no_container_is_told_of_peers_beyond_its_overlay(told: str) -> None:
    right, strange = containers(r1="10.128.0.11;10.128.0.12"), containers(r1=told)
    assert list(told_of_strangers(right, [*right, *bridges(**ENDS)])) == []
    assert list(told_of_strangers(strange, [*strange, *bridges(**ENDS)])) == [strange[0]]
    assert list(astray(strange, [*strange, *bridges(**ENDS)], UNDERLAYS)) == [strange[0]]
    assert list(told_of_strangers(right, right)) == [right[0]], "it is on none"
