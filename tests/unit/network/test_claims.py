"""What one robot says that an instance has, against what another one says of itself."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from srprov.definitions.model import NetworkSettings
from srprov.errors import UsageError
from srprov.facts.model import Link
from srprov.network.identity import identify, link_names
from srprov.network.layout import layout
from srprov.network.record import PlacementRecord
from tests.unit.assignment.worlds import experiment, found, robot, service
from tests.unit.network.test_identity import HELLO, NO_WISH, network

BETA = {"r2": (network("beta", subnet="10.130.0.0/20", vni=77, port=4789),)}


def test_another_robot_s_word_gives_no_robot_a_vni_that_others_have_there() -> None:
    """Its filter would let the robot that lies send into an overlay that it is no member of."""
    lie = network("hello", subnet="10.140.16.0/20", vni=77, port=4789)
    link = Link(name="srpvff92b3f2", kind="vxlan", vni=77, port=4789, alias="srprov:beta")
    theirs = (found(robot("r1"), robot("r2"), observed=BETA), found(robot("r1"), robot("r2", links=(link,))))
    for there in theirs:
        lying = replace(there, observed={**there.observed, "r1": (lie,)})
        assert identify("hello", NO_WISH, lying).vni == HELLO.vni
        assert identify("hello", NO_WISH, lying, members=["r1"]).vni == 77, "r2 gets nothing of it"
        assert identify("hello", NO_WISH, there, PlacementRecord(vni=77)).vni == HELLO.vni
    assert identify("hello", NetworkSettings(port=8472), lying).vni == 77, "another port is another overlay"


def test_another_robot_s_word_gives_no_robot_a_subnet_that_it_routes_elsewhere() -> None:
    lie = network("hello", subnet="10.200.0.0/20", vni=1234567, port=4789)
    for facts in ({"routes": ("10.200.0.0/16",)}, {"links": (Link(name="tun0", addresses=("10.200.9.1/24",)),)}):
        there = found(robot("r1"), robot("r2", **facts), observed={"r1": (lie,)})
        assert identify("hello", NO_WISH, there).subnet == HELLO.subnet
        with pytest.raises(UsageError, match=r"10\.200\.0\.0/20 overlaps .* on r2"):
            identify("hello", NetworkSettings(subnet="10.200.0.0/20"), there)
    theirs = found(robot("r1"), robot("r2"), observed={**BETA, "r1": (network("hello", subnet="10.130.0.0/20"),)})
    assert identify("hello", NO_WISH, theirs).subnet == HELLO.subnet


def test_no_overlay_lies_over_a_member_of_another_one_that_only_its_peers_reach() -> None:
    """By the default route, that is: a container could take its address, and be sent what the other overlay sends."""
    beta = {"beta": {"robots": {"r9": {"vtep": "10.200.7.13"}, "r8": {"vtep": "10.0.0.0/8"}}}}
    there = found(robot("r1"), robot("r2"), records={"r2": beta})
    for near in ("10.200.7.0/24", "10.200.7.8/29", "10.200.0.0/20"):
        with pytest.raises(UsageError, match=rf"{near} overlaps 10\.200\.7\.13, a member of .*'beta' \(as r2 says\)"):
            identify("hello", NetworkSettings(subnet=near), there)
    over = replace(there, records={"r1": {"beta": {"robots": {"r9": {"vtep": str(HELLO.subnet[77])}}}}})
    assert identify("hello", NO_WISH, over).subnet != HELLO.subnet, "nor one that is chosen"
    lie = replace(there, observed={"r1": (network("hello", subnet="10.200.0.0/20"),)})
    assert identify("hello", NO_WISH, lie).subnet == HELLO.subnet, "nor by another robot's word"
    own = replace(there, records={"r2": {"hello": beta["beta"]}})
    assert str(identify("hello", NetworkSettings(subnet="10.200.0.0/20"), own).subnet) == "10.200.0.0/20"


def test_no_member_is_sent_to_by_way_of_another_instance_s_overlay() -> None:
    """It may have been there first: its containers would be sent what this one's robots say to each other."""
    what = experiment(service("a"), service("b"))
    placed = {"a": "r1", "b": "r2"}
    over = {"r1": (network("beta", subnet="192.168.7.0/24"),)}
    robots = robot("r1", underlay_address="10.0.0.1"), robot("r2", underlay_address="192.168.7.13")
    with pytest.raises(UsageError, match=r"r1 would send what is for 192\.168\.7\.13 into network .*beta' on r1"):
        layout(what, placed, found(*robots, observed=over))
    own = {"r2": over["r1"]}
    layout(what, placed, found(*robots, observed=own))  # its own word about where it is itself sends nobody anywhere
    layout(what, placed, found(*robots, observed={"r3": over["r1"]}))
    layout(what, placed, found(*robots))


def test_what_a_robot_has_stays_though_a_route_came_later() -> None:
    used = network("hello", subnet="10.200.0.0/20", vni=1234567, port=4789)
    there = found(robot("r1", routes=("10.200.0.0/16",)), observed={"r1": (used,)})
    assert str(identify("hello", NO_WISH, there).subnet) == "10.200.0.0/20"


def test_a_robot_has_one_voice_however_many_networks_it_tells_of() -> None:
    truth, lie = (network("hello", subnet=f"10.{two}.0.0/20", vni=two, port=4789) for two in (200, 130))
    there = found(*map(robot, ("r1", "r2", "r3")), observed={"r1": (truth,), "r2": (truth,), "r3": (lie,) * 9})
    record = PlacementRecord(subnet="10.200.0.0/20", vni=200)
    identity = identify("hello", NO_WISH, there)
    assert (identity.vni, str(identity.subnet)) == (200, "10.200.0.0/20")
    two = replace(there, observed={"r1": (truth,), "r3": (lie,) * 9})
    identity = identify("hello", NO_WISH, two, record)
    assert (identity.vni, str(identity.subnet)) == (200, "10.200.0.0/20"), "of two, the one that was last"
    assert identify("hello", NO_WISH, two, members=["r1"]).vni == 200, "r3 gets nothing of it"


def test_a_network_with_the_bridge_of_an_instance_is_anothers_also_without_its_link() -> None:
    """Names have 32 bits of a hash, so a stranger finds one; a robot that was restarted has the bridge alone."""
    twin = "demo-1a3ftp20"
    assert link_names(twin) == link_names("hello")
    there = found(robot("r0"), observed={"r0": (network("hello", bridge="srpbabf8c589"),)})
    with pytest.raises(UsageError, match=r"network srprov\.hello on r0 belongs to 'hello'"):
        identify(twin, NO_WISH, there)
    assert identify("hello", NO_WISH, there).bridge == "srpbabf8c589"
