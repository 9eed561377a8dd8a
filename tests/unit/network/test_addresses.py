"""Fixed addresses: a hash, what is in use, the next free one."""

from __future__ import annotations

from ipaddress import IPv4Address, IPv4Network

import pytest

from srprov.errors import UsageError
from srprov.network.addresses import allocate
from srprov.network.identity import number
from srprov.network.record import PlacementRecord

WIDE = IPv4Network("10.200.0.0/20")
SMALL = IPv4Network("10.200.0.0/29")


def test_addresses_follow_the_documented_hash() -> None:
    given = allocate("hello", WIDE, ["talker"], ["r1"])
    assert given.services["talker"] == str(IPv4Address("10.200.0.1") + number("service", "hello", "talker") % 4094)
    assert given.gateways["r1"] == str(IPv4Address("10.200.0.1") + number("gateway", "hello", "r1") % 4094)
    assert given.macs["talker"] == "02:" + ":".join(
        f"{number('mac', 'hello', 'talker') % (1 << 40):010x}"[i : i + 2] for i in range(0, 10, 2)
    )


def test_a_service_and_a_robot_of_one_name_differ() -> None:
    given = allocate("hello", WIDE, ["x"], ["x"])
    assert given.services["x"] != given.gateways["x"]


def test_a_full_subnet_gives_every_address_once() -> None:
    given = allocate("hello", SMALL, ["a", "b", "c", "d"], ["r1", "r2"])
    assert sorted([*given.services.values(), *given.gateways.values()]) == [f"10.200.0.{i}" for i in range(1, 7)]


def test_too_many_names() -> None:
    with pytest.raises(UsageError, match="has 6 addresses, 7 are needed"):
        allocate("hello", SMALL, ["a", "b", "c", "d", "e"], ["r1", "r2"])


def test_what_is_in_use_wins() -> None:
    used = PlacementRecord(
        addresses={"b": IPv4Address("10.200.0.3")},
        gateways={"r1": IPv4Address("10.200.0.4")},
        macs={"b": "02:00:00:00:00:01"},
    )
    given = allocate("hello", SMALL, ["a", "b", "c"], ["r1", "r2"], used)
    assert given.services["b"] == "10.200.0.3"
    assert given.gateways["r1"] == "10.200.0.4"
    assert given.macs["b"] == "02:00:00:00:00:01"
    assert len({*given.services.values(), *given.gateways.values()}) == 5


@pytest.mark.parametrize("address", ["10.200.0.0", "10.200.0.7", "10.201.0.3", "0.0.0.0"])
def test_what_does_not_fit_the_subnet_is_not_kept(address: str) -> None:
    given = allocate("hello", SMALL, ["a"], [], PlacementRecord(addresses={"a": IPv4Address(address)}))
    assert given == allocate("hello", SMALL, ["a"], [])


def test_two_names_with_one_recorded_address_part() -> None:
    both = dict.fromkeys(("a", "b"), IPv4Address("10.200.0.3"))
    macs = dict.fromkeys(("a", "b"), "02:00:00:00:00:01")
    given = allocate("hello", SMALL, ["a", "b"], [], PlacementRecord(addresses=both, macs=macs))
    assert given.services["a"] == "10.200.0.3" != given.services["b"]
    assert given.macs["a"] == "02:00:00:00:00:01" != given.macs["b"]


def test_a_mac_that_is_not_locally_administered_is_not_kept() -> None:
    given = allocate("hello", SMALL, ["a"], [], PlacementRecord(macs={"a": "01:00:5e:00:00:01"}))
    assert given == allocate("hello", SMALL, ["a"], [])
