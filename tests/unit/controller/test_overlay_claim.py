"""What a plan file says of an encrypted overlay's peers: each robot's key stands beside its own addresses."""

from __future__ import annotations

import pytest

from srprov.controller.overlay_claim import mixed_up
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
        right := peers(("r2", "192.0.2.2:20000", ENDS["r2"]), ("r3", "192.0.2.3:1", "10.128.0.3")),
    ]
    assert list(mixed_up([right], wants, UNDERLAYS)) == []
    assert list(mixed_up([], [*wants, peers(("r3", "192.0.2.2:20000", ENDS["r2"]))], UNDERLAYS)) == []
