"""The parsers, one by one, where their edges are."""

import pytest

from srprov.facts.answers import (
    parse_count,
    parse_devices,
    parse_disk,
    parse_files,
    parse_identity,
    parse_traffic,
    parse_wireless,
)
from srprov.facts.links import parse_links, parse_routes
from srprov.untrusted import decimal, integer, json_or_none, text


@pytest.mark.parametrize(
    "value", ["nan", "inf", "-inf", "1e5", "0x10", "", " ", "1_000", "٣", None, True, [], "9" * 40]
)
def test_no_number(value: object) -> None:
    assert integer(value, low=0, high=10, default=-7) == -7
    assert decimal(value, low=0, high=10, default=-7) == -7


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 10**400])
def test_no_finite_number(value: object) -> None:
    assert decimal(value, low=0, high=10, default=-7) == -7


def test_text_is_one_short_printable_line() -> None:
    assert text("a\nb\x00\u202ec\ud800") == "abc"
    assert len(text("x" * 10**6)) == 200
    assert text(5) == ""


def test_json_that_is_too_deep_is_none() -> None:
    assert json_or_none("[" * 200_000) is None


def test_identity_takes_the_first_of_each() -> None:
    found = parse_identity("clock 5.5\nclock 9\nconnection a b 10.0.0.1 22\nuser me\nuser you\nid x\n")
    assert (found.clock_s, found.reached_at, found.user, found.uid) == (5.5, "10.0.0.1", "me", -1)
    own = parse_identity("bits 32\nid uid=1000(anna) gid=1000(anna) groups=1000(anna),27(sudo)\nuser root\n")
    assert (own.user, own.uid, own.bits) == ("root", 1000, 32)
    assert parse_identity("id uid=1000(anna) gid=1000(anna)\n").user == "anna"


@pytest.mark.parametrize(
    "path",
    ["/etc/passwd", "/dev/../etc", "/dev/video*", "/dev/a b", "/dev/$(x)", "/dev/", "/dev/-x", "/dev/" + "x" * 300],
)
def test_device_paths_are_plain(path: str) -> None:
    assert parse_devices(f"dev {path}\nother /dev/video0\ndev\n").known == ()


def test_files_keep_colons_and_empty_lines() -> None:
    assert parse_files("/a:b:c\n/a:\n/d:e\nnonsense\n") == {"/a": ("b:c", ""), "/d": ("e",)}


@pytest.mark.parametrize(("out", "count"), [("4\n", 4), ("", 0), ("-3", 0), ("x", 0), ("99999", 4096)])
def test_count(out: str, count: int) -> None:
    assert parse_count(out) == count


def test_wireless_interfaces_and_their_rates() -> None:
    out = "wireless wlan0\nNot connected.\nwireless wlan1\n\ttx bitrate: 866.7 MBit/s VHT-MCS 9\n\ttx bitrate: x\n"
    assert parse_wireless(out) == {"wlan0": 0.0, "wlan1": 866.7}


def test_df_with_blanks_in_names() -> None:
    out = "Filesystem 1024-blocks Used Available Capacity Mounted on\n//nas/my share 100 20 80 20% /mnt/my share\n"
    (found,) = parse_disk(out).mounts
    assert (found.mount, found.total, found.free) == ("/mnt/my share", 102400, 81920)


def test_df_never_has_more_free_than_there_is() -> None:
    (found,) = parse_disk("/dev/x 100 0 500 0% /\n").mounts
    assert found.free == found.total


def test_traffic_of_a_counter_that_went_back_is_none() -> None:
    row = "  eth0: {} 0 0 0 0 0 0 0 {} 0 0 0 0 0 0 0\n"
    found = parse_traffic("1.00 1\n" + row.format(500, 100) + "2.00 2\n" + row.format(100, 350))
    assert (found["eth0"].received_bps, found["eth0"].sent_bps) == (0.0, 250.0)


def test_traffic_needs_both_readings() -> None:
    assert parse_traffic("1.00 1\n  eth0: 1 0 0 0 0 0 0 0 1 0 0 0 0 0 0 0\n") == {}


@pytest.mark.parametrize(
    "out", ["", "{}", "[1, null, []]", '[{"ifname": 7}]', '[{"ifname": "a/b"}]', '[{"ifname": "' + "x" * 16 + '"}]']
)
def test_links_that_are_none(out: str) -> None:
    assert parse_links(out) == ()


def test_links_with_odd_fields_keep_defaults() -> None:
    (link,) = parse_links(
        '[{"ifname": "eth0", "mtu": "big", "flags": 3, "addr_info": [{"local": "x", "prefixlen": 99}]}]'
    )
    assert (link.mtu, link.up, link.addresses) == (1500, False, ())


def test_an_address_that_is_not_ready_is_none() -> None:
    out = '[{"ifname": "e", "addr_info": [{"local": "10.0.0.1", "prefixlen": 8, "tentative": true}]}]'
    assert parse_links(out)[0].addresses == ()


@pytest.mark.parametrize("out", ["", "null", '[{"dst": 4}]', '[{"dst": "x"}]', '[{"dst": "::/0"}]'])
def test_routes_that_are_none(out: str) -> None:
    assert parse_routes(out).destinations == ()


def test_a_host_route_is_a_network_of_one() -> None:
    assert parse_routes('[{"dst": "10.0.0.7", "dev": "eth0"}]').destinations == ("10.0.0.7/32",)
