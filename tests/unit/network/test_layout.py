"""Who is where on the overlay, and what each robot must know."""

from __future__ import annotations

import json
from collections.abc import Mapping

import pytest

from srprov.definitions.model import Experiment, NetworkSettings
from srprov.errors import UsageError
from srprov.facts.model import Snapshot
from srprov.facts.placements import read_placements
from srprov.network.hosts import HostsFile
from srprov.network.layout import layout
from srprov.network.model import Overlay
from srprov.network.record import read_record, record
from tests.unit.assignment.worlds import experiment, found, robot, service

PLACED = {"map": "r1", "talker": "r2", "listener": "r3"}


def lab(**per_robot: Mapping[str, object]) -> Snapshot:
    names = ("r1", "r2", "r3")
    return found(*(robot(n, **{"underlay_address": f"192.168.0.{n[1]}", **per_robot.get(n, {})}) for n in names))


def three(**fields: object) -> Experiment:
    return experiment(*(service(name) for name in PLACED), **fields)


def test_every_member_knows_all_others() -> None:
    """Every member knows all others."""
    overlay = layout(three(), PLACED, lab())
    assert overlay.active
    assert overlay.vteps == {"r1": "192.168.0.1", "r2": "192.168.0.2", "r3": "192.168.0.3"}
    assert overlay.flood["r2"] == ("192.168.0.1", "192.168.0.3")
    assert set(overlay.fdb["r2"]) == {
        (overlay.macs["map"], "192.168.0.1"),
        (overlay.macs["listener"], "192.168.0.3"),
        (overlay.bridge_macs["r1"], "192.168.0.1"),
        (overlay.bridge_macs["r3"], "192.168.0.3"),
    }
    assert overlay.fdb["r2"] == tuple(sorted(overlay.fdb["r2"]))
    assert len({*overlay.addresses.values(), *overlay.gateways.values()}) == 6
    assert overlay.names == overlay.addresses


def test_several_services_on_one_robot_need_no_entries_there() -> None:
    """Several services on one robot need no entries there."""
    overlay = layout(three(), dict.fromkeys(PLACED, "r1"), lab())
    assert overlay.vteps == {"r1": "192.168.0.1"}
    assert overlay.flood == {"r1": ()}
    assert overlay.fdb == {"r1": ()}


def test_a_robot_with_nothing_on_the_overlay_is_no_member() -> None:
    """A robot with nothing on the overlay is no member."""
    what = experiment(service("map"), service("talker", network="host"), service("listener", network="none"))
    overlay = layout(what, PLACED, lab())
    assert list(overlay.vteps) == ["r1"]
    assert overlay.underlays == {"r1": "192.168.0.1", "r2": "192.168.0.2", "r3": "192.168.0.3"}
    assert overlay.names == {"map": overlay.addresses["map"], "talker": "192.168.0.2"}


def test_both_has_an_address_but_no_interface_of_its_own() -> None:
    """Both has an address but no interface of its own."""
    what = experiment(service("map"), service("talker", network="both"), service("listener"))
    overlay = layout(what, PLACED, lab())
    assert overlay.names["talker"] == overlay.addresses["talker"]
    assert sorted(overlay.macs) == ["listener", "map"]
    assert "r2" in overlay.vteps
    # what goes to its address goes to the bridge of its robot
    assert len({*overlay.bridge_macs.values(), *overlay.macs.values()}) == 5
    assert set(overlay.fdb["r1"]) == {
        (overlay.bridge_macs["r2"], "192.168.0.2"),
        (overlay.bridge_macs["r3"], "192.168.0.3"),
        (overlay.macs["listener"], "192.168.0.3"),
    }
    assert overlay.bridge_macs["r2"] not in dict(overlay.fdb["r2"])


def test_two_services_of_both_on_one_robot_share_the_mac_of_its_bridge() -> None:
    """Two services of both on one robot share the MAC of its bridge."""
    what = experiment(service("map"), service("talker", network="both"), service("listener", network="both"))
    overlay = layout(what, {"map": "r1", "talker": "r2", "listener": "r2"}, lab())
    assert overlay.addresses["talker"] != overlay.addresses["listener"]
    assert overlay.fdb["r1"] == ((overlay.bridge_macs["r2"], "192.168.0.2"),)


def test_without_the_overlay_names_remain() -> None:
    """Without the overlay names remain."""
    what = experiment(*(service(name, network="host") for name in PLACED))
    overlay = layout(what, PLACED, lab())
    assert not overlay.active
    assert (overlay.vni, overlay.subnet, overlay.mtu, overlay.bridge) == (0, "", 0, "")
    assert overlay.names == {"map": "192.168.0.1", "talker": "192.168.0.2", "listener": "192.168.0.3"}


def test_the_instance_is_the_experiments_name_unless_given() -> None:
    """The instance is the experiments name unless given."""
    assert layout(three(), PLACED, lab()).network == "srprov.hello"
    other = layout(three(), PLACED, lab(), instance="second")
    assert (other.instance, other.network) == ("second", "srprov.second")
    assert other.vni != layout(three(), PLACED, lab()).vni


@pytest.mark.parametrize(
    ("per_robot", "wish", "mtu"),
    [
        ({}, None, 1450),
        ({"r2": {"underlay_mtu": 1420}}, None, 1370),
        ({"r1": {"underlay_mtu": 9000}, "r2": {"underlay_mtu": 9000}, "r3": {"underlay_mtu": 9000}}, None, 8950),
        ({f"r{i}": {"underlay_address": f"fd00::{i}"} for i in (1, 2, 3)}, None, 1430),
        ({}, 1300, 1300),
        ({}, 1450, 1450),
    ],
)
def test_mtu(per_robot: dict[str, dict[str, object]], wish: int | None, mtu: int) -> None:
    """Mtu."""
    assert layout(three(network=NetworkSettings(mtu=wish)), PLACED, lab(**per_robot)).mtu == mtu


@pytest.mark.parametrize(
    ("per_robot", "wishes", "message"),
    [
        ({"r2": {"underlay_mtu": 1400}}, {"mtu": 1400}, "network.mtu 1400 is more than r2's underlay leaves: 1350"),
        ({"r2": {"underlay_address": ""}}, {}, "r2 has no address that other robots reach"),
        ({"r3": {"underlay_address": "192.168.0.1"}}, {}, "r1 and r3 have the same underlay address 192.168.0.1"),
        ({"r2": {"underlay_address": "fd00::2"}}, {}, "r3 has an IPv4 underlay address, r2 an IPv6 one"),
        ({"r2": {"underlay_mtu": 0}}, {}, "r2's underlay leaves -50 bytes for a packet of the overlay"),
        ({"r2": {"underlay_mtu": 625}}, {}, "r2's underlay leaves 575 bytes .* 576 are the least"),
        ({}, {"subnet": "10.200.0.0/29", "vni": 1}, None),
    ],
)
def test_what_cannot_be_a_segment(
    per_robot: dict[str, dict[str, object]], wishes: dict[str, object], message: str | None
) -> None:
    """What cannot be a segment."""
    what = three(network=NetworkSettings(**wishes))
    if message is None:
        assert layout(what, PLACED, lab(**per_robot)).subnet == "10.200.0.0/29"
        return
    with pytest.raises(UsageError, match=message) as caught:
        layout(what, PLACED, lab(**per_robot))
    assert caught.value.hint


def test_a_robot_out_of_reach_stays_a_member_with_all_it_had() -> None:
    """A robot out of reach stays a member with all it had."""
    what, before = three(), layout(three(), PLACED, lab(r2={"underlay_mtu": 1400}))
    remembered = record(before, what, PLACED, "here")
    rest = [one for name, one in lab().facts.items() if name != "r2"]
    there = found(*rest, unreachable={"r2": "no route to host"}, placements={"hello": remembered})
    assert layout(what, PLACED, there) == before


def test_a_robot_out_of_reach_that_nobody_remembers_is_left_out() -> None:
    """A robot out of reach that nobody remembers is left out."""
    rest = [one for name, one in lab().facts.items() if name != "r2"]
    overlay = layout(three(), PLACED, found(*rest, unreachable={"r2": ""}))
    assert list(overlay.vteps) == ["r1", "r3"]
    assert overlay.flood == {"r1": ("192.168.0.3",), "r3": ("192.168.0.1",)}
    assert "talker" in overlay.addresses


def test_a_service_keeps_its_addresses_when_it_moves() -> None:
    """A service keeps its addresses when it moves."""
    before = layout(three(), PLACED, lab())
    after = layout(three(), {**PLACED, "map": "r3"}, lab())
    assert after.addresses == before.addresses
    assert after.macs == before.macs
    assert after.gateways.items() <= before.gateways.items()


def test_hosts_file() -> None:
    """Hosts file."""
    overlay = Overlay(instance="x", underlays={}, names={"talker": "10.0.0.9", "cam": "fd00::1", "map": "10.0.0.10"})
    assert HostsFile(overlay).text == (
        "127.0.0.1\tlocalhost\n"
        "::1\tlocalhost ip6-localhost ip6-loopback\n"
        "ff02::1\tip6-allnodes\n"
        "ff02::2\tip6-allrouters\n"
        "fd00::1\tcam\n"
        "10.0.0.10\tmap\n"
        "10.0.0.9\ttalker\n"
    )


def test_a_robots_own_lines_stand_below_without_names_that_mean_something_else() -> None:
    """A resolver gives all addresses of a name, so a second one would be a service elsewhere."""
    overlay = Overlay(instance="x", underlays={}, names={"talker": "10.0.0.9"})
    own = ("127.0.0.1 localhost", "10.6.6.6 Talker talker.lab", "10.6.6.7 extra", "127.0.1.1 robot1", "fd00::1 cam")
    text = HostsFile(overlay, {"talker": "turtle"}).with_more([("extra", "10.0.0.7")], own)
    assert text.splitlines()[4:] == [
        "10.0.0.9\ttalker", "10.0.0.9\tturtle", "10.0.0.7\textra",
        "10.6.6.6\ttalker.lab", "127.0.1.1\trobot1", "fd00::1\tcam",
    ]  # fmt: skip


def test_a_robots_own_name_gives_way_in_any_case_and_a_name_of_blanks_breaks_nothing() -> None:
    overlay = Overlay(instance="x", underlays={}, names={"\r": "10.0.0.9"})
    text = HostsFile(overlay).with_more([("Printer", "10.0.0.7")], ["10.6.6.7 printer scanner"])
    assert text.endswith("10.0.0.9\t\r\n10.0.0.7\tPrinter\n10.6.6.7\tscanner\n")


def test_the_record_holds_the_whole_placement() -> None:
    """The record holds the whole placement."""
    what = experiment(service("map"), service("talker", network="host"))
    placed = {"talker": "r2", "map": "r1"}
    overlay = layout(what, placed, lab())
    value = record(overlay, what, placed, "git@example.org:lab/hello.git hello.edf")
    assert value == {
        "instance": "hello",
        "mtu": 1450,
        "port": 4789,
        "robots": {
            "r1": {"gateway": overlay.gateways["r1"], "vtep": "192.168.0.1"},
            "r2": {"gateway": "", "vtep": "192.168.0.2"},
        },
        "serial": 1,
        "services": {
            "map": {"ip": overlay.addresses["map"], "mac": overlay.macs["map"], "network": "overlay", "robot": "r1"},
            "talker": {"ip": "", "mac": "", "network": "host", "robot": "r2"},
        },
        "source": "git@example.org:lab/hello.git hello.edf",
        "subnet": overlay.subnet,
        "vni": overlay.vni,
    }
    assert list(value) == sorted(value)


def test_the_serial_counts_changes_only() -> None:
    """The serial counts changes only."""
    what, overlay = three(), layout(three(), PLACED, lab())
    first = record(overlay, what, PLACED, "here")
    assert record(overlay, what, PLACED, "here", first) == first
    moved = {**PLACED, "map": "r2"}
    second = record(layout(what, moved, lab()), what, moved, "here", {**first, "serial": 41})
    assert second["serial"] == 42


@pytest.mark.parametrize("said", [-3, 0, 3, 2**31 - 2, 2**31 - 1, 2**31, 10**18, 2**64])
def test_whatever_serial_a_robot_says_what_is_written_next_is_read_as_it_was_written(said: int) -> None:
    """Else this machine would not know its own record on any robot, and a plan file of its own would be refused."""
    what, overlay = three(), layout(three(), PLACED, lab())
    forged = {**record(overlay, what, PLACED, "here"), "mtu": 1280, "serial": said}
    before = read_placements([json.dumps(forged)])["hello"]
    written = record(overlay, what, PLACED, "here", before)
    assert read_placements([json.dumps(written)]) == {"hello": written}
    assert 0 < written["serial"] < 2**31 and written["serial"] != before["serial"]


def test_read_record_gives_back_what_was_written() -> None:
    """Read record gives back what was written."""
    what, overlay = three(), layout(three(), PLACED, lab())
    read = read_record(record(overlay, what, PLACED, "here"))
    assert read is not None
    assert read.robots == PLACED
    assert {name: str(ip) for name, ip in read.addresses.items()} == overlay.addresses
    assert read.macs == overlay.macs
    assert read.vteps == overlay.vteps
    assert (read.vni, read.subnet, read.mtu, read.source, read.serial) == (
        overlay.vni,
        overlay.subnet,
        1450,
        "here",
        1,
    )
    assert read_record(None) is None


@pytest.mark.parametrize(
    "value",
    [
        {},
        {"services": [], "robots": "x", "vni": True, "serial": -3, "mtu": "1450", "subnet": None},
        {
            "services": {"a": {"robot": 1, "ip": "10.0.0.999", "mac": "02:zz"}, "b": 7},
            "robots": {"r": {"vtep": "$(id)"}},
        },
    ],
)
def test_read_record_believes_nothing_odd(value: dict[str, object]) -> None:
    """Read record believes nothing odd."""
    read = read_record(value)
    assert read is not None
    assert not (read.robots or read.addresses or read.macs or read.vteps or read.gateways)
    assert (read.vni, read.subnet, read.mtu, read.source, read.serial) == (0, "", 0, "", 0)


@pytest.mark.parametrize(("wish", "remembered", "mtu"), [(None, 1200, 1200), (None, 5, 1450), (1400, 1200, 1400)])
def test_the_mtu_of_a_robot_out_of_reach_is_the_last_placements(wish: int | None, remembered: int, mtu: int) -> None:
    """The mtu of a robot out of reach is the last placements."""
    what = three(network=NetworkSettings(mtu=wish))
    value = {**record(layout(what, PLACED, lab()), what, PLACED, "here"), "mtu": remembered}
    rest = [one for name, one in lab().facts.items() if name != "r2"]
    there = found(*rest, unreachable={"r2": ""}, placements={"hello": value})
    assert layout(what, PLACED, there).mtu == mtu


def test_the_mtu_stays_when_the_robot_with_the_narrowest_link_is_no_member_any_more() -> None:
    """And goes down with one that joins: nothing larger would get through to it."""
    what, narrow = three(), lab(r2={"underlay_mtu": 1400})
    first = layout(what, PLACED, narrow)
    kept = {"hello": record(first, what, PLACED, "here")}
    without = {**PLACED, "talker": "r1"}
    assert (first.mtu, layout(what, without, narrow).mtu) == (1350, 1450)
    assert layout(what, without, found(*narrow.facts.values(), placements=kept)).mtu == 1350
    wide = {"hello": record(layout(what, without, narrow), what, without, "here")}
    assert layout(what, PLACED, found(*narrow.facts.values(), placements=wide)).mtu == 1350


def test_the_name_of_a_replicated_service_resolves_to_all_instances() -> None:
    """Each instance has its own name, and one more line under the name that the EDF has."""
    what = experiment(
        service("w-1", instance_of="w"), service("w-2", instance_of="w"), service("h", network="host", instance_of="w")
    )
    overlay = layout(what, {"w-1": "r1", "w-2": "r2", "h": "r3"}, lab())
    assert overlay.aliases == {"w": (overlay.names["h"], overlay.names["w-1"], overlay.names["w-2"])}
    lines = HostsFile(overlay).text.splitlines()[-6:]
    assert [line.split("\t")[1] for line in lines] == ["h", "w-1", "w-2", "w", "w", "w"]
