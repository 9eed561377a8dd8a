"""VNI, names and subnet: a documented hash, what is in use, what the EDF wants, and what others have."""

from __future__ import annotations

import hashlib
from ipaddress import IPv4Network

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from srprov.definitions.model import NetworkSettings
from srprov.errors import UsageError
from srprov.facts.model import Link, Snapshot
from srprov.network.foreign import Ranges
from srprov.network.identity import POOL, identify, link_names, number
from srprov.network.record import PlacementRecord
from srprov.resource import Observed
from tests.unit.assignment.worlds import found, robot

NO_WISH = NetworkSettings()
HELLO = identify("hello", NO_WISH, Snapshot(facts={}, observed={}))


def network(instance: str, **state: object) -> Observed:
    return Observed(module="network", name=f"srprov.{instance}", instance=instance, state=state)


def with_networks(*per_robot: Observed) -> Snapshot:
    robots = [robot(f"r{index}") for index in range(len(per_robot))]
    return found(*robots, observed={one.name: (thing,) for one, thing in zip(robots, per_robot, strict=True)})


def test_the_hash_is_the_documented_one() -> None:
    digest = hashlib.sha256(b"srprov/vni/hello/").hexdigest()
    assert number("vni", "hello") == int(digest[:16], 16)
    assert number("service", "hello", "talker") == int(
        hashlib.sha256(b"srprov/service/hello/talker").hexdigest()[:16], 16
    )


def test_what_hello_gets_never_changes() -> None:
    assert HELLO.vni == 0x100000 + number("vni", "hello") % 0xF00000
    assert (HELLO.vni, str(HELLO.subnet)) == (8602346, "10.231.112.0/20")
    assert (HELLO.bridge, HELLO.link, HELLO.network) == ("srpbabf8c589", "srpvabf8c589", "srprov.hello")
    assert HELLO.port == 4789


@pytest.mark.parametrize("instance", ["a", "hello", "x" * 32, "hello-2"])
def test_everything_has_its_bounds(instance: str) -> None:
    identity = identify(instance, NO_WISH, Snapshot(facts={}, observed={}))
    assert 0x100000 <= identity.vni <= 0xFFFFFF
    assert identity.subnet.subnet_of(POOL)
    assert identity.subnet.prefixlen == 20
    assert all(len(name) == 12 for name in link_names(instance))


@pytest.mark.parametrize(
    "facts",
    [
        {"routes": ("0.0.0.0/0", "10.231.113.0/24")},
        {"routes": ("10.231.0.0/18", "10.231.64.0/18")},
        {"links": (Link(name="br-1", addresses=("fe80::1/64", "10.231.120.1/24")),)},
        {"underlay_address": "10.231.127.254"},
    ],
)
def test_a_taken_subnet_gives_way_to_the_next(facts: dict[str, object]) -> None:
    assert identify("hello", NO_WISH, found(robot("r1"), robot("r2", **facts))).subnet == IPv4Network("10.231.128.0/20")


def test_routes_that_lead_everywhere_claim_nothing() -> None:
    vpn = robot("r1", routes=("0.0.0.0/0", "0.0.0.0/1", "128.0.0.0/1", "default", "fd00::/8", "nonsense"))
    assert identify("hello", NO_WISH, found(vpn)).subnet == HELLO.subnet


def test_no_subnet_left() -> None:
    with pytest.raises(UsageError, match=r"no /20 of 10\.128\.0\.0/9 is free"):
        identify("hello", NO_WISH, found(robot("r1", routes=("10.0.0.0/8",))))


@pytest.mark.parametrize(
    ("link", "vni"),
    [
        (Link(name="vx0", kind="vxlan", vni=8602346, port=4789), 8602347),
        (Link(name="vx0", kind="vxlan", vni=8602346, port=8472), 8602346),
        (Link(name="srpvabf8c589", kind="vxlan", vni=8602346, port=4789, alias="srprov:hello"), 8602346),
        (Link(name="srpvabf8c589", kind="vxlan", vni=8602346, port=4789), 8602346),
    ],
)
def test_a_vni_gives_way_on_the_same_port_only(link: Link, vni: int) -> None:
    assert identify("hello", NO_WISH, found(robot("r1", links=(link,)))).vni == vni


def test_other_instances_are_avoided_also_where_only_their_record_is_known() -> None:
    theirs = {"subnet": "10.231.112.0/20", "vni": 8602346, "port": 4789}
    for there in (with_networks(network("other", **theirs)), found(robot("r1"), records={"r1": {"other": theirs}})):
        identity = identify("hello", NO_WISH, there)
        assert (identity.vni, str(identity.subnet)) == (8602347, "10.231.128.0/20")


def test_what_the_instance_uses_wins_over_the_hash_and_over_claims() -> None:
    used = network("hello", subnet="10.140.16.0/20", vni=1234567, port=4789)
    mine = Link(name="srpbabf8c589", kind="bridge", addresses=("10.140.20.1/20",))
    there = found(robot("r1", routes=("10.140.16.0/20",), links=(mine,)), observed={"r1": (used,)})
    identity = identify("hello", NO_WISH, there)
    assert (identity.vni, str(identity.subnet)) == (1234567, "10.140.16.0/20")


def test_the_record_speaks_when_no_network_is_there() -> None:
    record = PlacementRecord(subnet="10.140.16.0/20", vni=1234567)
    identity = identify("hello", NO_WISH, found(robot("r1")), record)
    assert (identity.vni, str(identity.subnet)) == (1234567, "10.140.16.0/20")


def test_our_own_bridge_claims_nothing_even_when_all_else_is_lost() -> None:
    mine = Link(name="srpbabf8c589", kind="bridge", addresses=("10.231.114.1/20",))
    there = found(robot("r1", routes=("10.231.112.0/20",), links=(mine,)))
    assert identify("hello", NO_WISH, there).subnet == HELLO.subnet


def test_robots_that_differ_follow_most_of_them() -> None:
    nets = [network("hello", subnet=f"10.{second}.0.0/20", vni=vni) for second, vni in ((200, 9), (130, 7), (130, 7))]
    identity = identify("hello", NO_WISH, with_networks(*nets))
    assert (identity.vni, str(identity.subnet)) == (7, "10.130.0.0/20")
    identity = identify("hello", NO_WISH, with_networks(*nets[:2]))
    assert (identity.vni, str(identity.subnet)) == (7, "10.130.0.0/20")


@pytest.mark.parametrize(
    "state",
    [
        {"subnet": "0.0.0.0/0", "vni": 1 << 24},
        {"subnet": "192.168.0.0/24", "vni": -1},
        {"subnet": "fd00::/64", "vni": "8602346"},
        {"subnet": 7, "vni": None},
        {},
    ],
)
def test_what_a_robot_says_is_not_believed_when_it_cannot_be(state: dict[str, object]) -> None:
    there = found(robot("r1", underlay_address="192.168.0.7"), observed={"r1": (network("hello", **state),)})
    identity = identify("hello", NO_WISH, there)
    assert (identity.vni, identity.subnet) == (HELLO.vni, HELLO.subnet)


VITAL = [{"relies_on": ("10.140.17.9",)}, {"links": (Link(name="eth1", addresses=("10.140.18.2/24",)),)},
         {"underlay_address": "10.140.16.5"}]  # fmt: skip


@pytest.mark.parametrize("facts", VITAL)
def test_a_subnet_over_what_a_robot_needs_is_neither_taken_from_a_record_nor_from_a_network(
    facts: dict[str, object],
) -> None:
    """Its own addresses, its SSH client, its gateways, its name and time servers: it would be cut off."""
    record = PlacementRecord(subnet="10.140.16.0/20", vni=1234567)
    used = network("hello", subnet="10.140.16.0/20", vni=1234567, port=4789)
    for there in (found(robot("r1", **facts)), found(robot("r1", **facts), observed={"r1": (used,)})):
        assert identify("hello", NO_WISH, there, record).subnet == HELLO.subnet


def test_a_subnet_that_only_a_record_knows_gives_way_to_a_route() -> None:
    record = PlacementRecord(subnet="10.140.16.0/20", vni=1234567)
    there = found(robot("r1", routes=("10.140.24.0/24",)))
    assert identify("hello", NO_WISH, there, record).subnet == HELLO.subnet


def test_what_a_robot_relies_on_is_never_chosen() -> None:
    there = found(robot("r1", relies_on=("10.231.115.4",)))
    assert str(identify("hello", NO_WISH, there).subnet) == "10.231.128.0/20"


@pytest.mark.parametrize("in_use", [False, True])
def test_a_wish_for_what_a_robot_relies_on_is_refused(in_use: bool) -> None:
    """Also when the instance has it already: the address may be new."""
    there = found(robot("r1", relies_on=("172.30.0.9",)))
    if in_use:
        there = replace(there, observed={"r1": (network("hello", subnet="172.30.0.0/24", vni=42),)})
    with pytest.raises(UsageError, match=r"172\.30\.0\.0/24 overlaps 172\.30\.0\.9, which r1 relies on"):
        identify("hello", NetworkSettings(subnet="172.30.0.0/24"), there)


def test_wishes_win() -> None:
    wishes = NetworkSettings(subnet="172.30.0.0/24", vni=42, port=8472)
    used = network("hello", subnet="10.140.16.0/20", vni=1234567, port=4789)
    identity = identify("hello", wishes, with_networks(used))
    assert (identity.vni, str(identity.subnet), identity.port) == (42, "172.30.0.0/24", 8472)


def test_a_wish_for_what_we_have_is_no_conflict() -> None:
    used = network("hello", subnet="172.30.0.0/24", vni=42, port=4789)
    mine = Link(name="srpvabf8c589", kind="vxlan", vni=42, port=4789, alias="srprov:hello")
    there = found(robot("r1", routes=("172.30.0.0/24",), links=(mine,)), observed={"r1": (used,)})
    for subnet in ("172.30.0.0/24", "172.30.0.0/16"):
        assert str(identify("hello", NetworkSettings(subnet=subnet, vni=42), there).subnet) == subnet


@pytest.mark.parametrize(
    ("wishes", "message"),
    [
        (NetworkSettings(subnet="192.168.0.0/16"), r"192\.168\.0\.0/16 overlaps the route to 192\.168\.7\.0/24 on r1"),
        (NetworkSettings(subnet="172.17.0.0/24"), "overlaps link docker0 on r1"),
        (NetworkSettings(subnet="10.200.0.0/20"), r"overlaps instance 'other' \(as r1 says\)"),
        (NetworkSettings(subnet="fd00::/64"), "is not an IPv4 network"),
        (NetworkSettings(subnet="10.0.0.0/30"), "of size /8 to /29"),
        (NetworkSettings(subnet="big"), "is not an IPv4 network"),
        (NetworkSettings(vni=77), "vni 77 is used by link vx0 on r1"),
        (NetworkSettings(vni=78), r"vni 78 is used by instance 'other' \(as r1 says\)"),
        (NetworkSettings(vni=0), r"vni 0 is not in 1\.\.16777215"),
    ],
)
def test_wishes_that_meet_something_foreign(wishes: NetworkSettings, message: str) -> None:
    links = (
        Link(name="docker0", kind="bridge", addresses=("172.17.0.1/16",)),
        Link(name="vx0", kind="vxlan", vni=77, port=4789),
    )
    other = {"other": {"subnet": "10.200.0.0/20", "vni": 78, "port": 4789}}
    there = found(robot("r1", routes=("192.168.7.0/24",), links=links), records={"r1": other})
    with pytest.raises(UsageError, match=message) as caught:
        identify("hello", wishes, there)
    assert caught.value.hint


def test_a_link_of_our_name_that_is_anothers() -> None:
    link = Link(name="srpvabf8c589", kind="vxlan", alias="srprov:twin")
    with pytest.raises(UsageError, match="link srpvabf8c589 on r1 belongs to 'twin'"):
        identify("hello", NO_WISH, found(robot("r1", links=(link,))))


def test_a_robot_cannot_have_a_subnet_of_the_labs_network_kept() -> None:
    """What srprov would not choose is the EDF's own wish, which asks for a permission, or it is not used."""
    used = network("hello", subnet="192.168.50.0/28", vni=1234567, port=4789)
    assert identify("hello", NO_WISH, with_networks(used)).subnet == HELLO.subnet
    wish = NetworkSettings(subnet="192.168.50.0/28")
    assert str(identify("hello", wish, with_networks(used)).subnet) == "192.168.50.0/28"


NETWORKS = st.builds(
    lambda start, prefix: IPv4Network((start >> (32 - prefix) << (32 - prefix), prefix)),
    st.integers(0, 2**32 - 1) | st.integers(0, 64),
    st.integers(8, 32) | st.integers(26, 32),
)


@given(st.lists(NETWORKS, max_size=12), NETWORKS)
def test_ranges_meet_what_overlaps(some: list[IPv4Network], other: IPv4Network) -> None:
    assert Ranges([*some, None]).meet(other) == any(one.overlaps(other) for one in some)


def test_a_port_on_which_a_link_takes_all_vnis_is_nobodys() -> None:
    """Such as Open vSwitch's or Cilium's: the link failed there, and other members sent that one their packets."""
    every = found(robot("r1"), robot("r2", links=(Link(name="vxlan_sys_4789", kind="vxlan", port=4789),)))
    with pytest.raises(UsageError, match=r"port 4789 is that of link vxlan_sys_4789 on r2, which takes all VNIs"):
        identify("hello", NO_WISH, every)
    assert identify("hello", NetworkSettings(port=4790), every).port == 4790
    assert identify("hello", NetworkSettings(encryption="wireguard"), every).port == 4789
    assert identify("hello", NO_WISH, every, members=["r1"]).port == 4789
