"""Each failed pair gets the cause that was measured or seen, and no other pair is named."""

from __future__ import annotations

from typing import Any

import pytest
from msgspec.structs import replace

from srprov.probing.causes import Cause, cause_json, judged
from srprov.probing.evidence import Evidence
from srprov.probing.firewall import Rule
from srprov.probing.look import Inside, LinkSeen, Look
from srprov.probing.model import Measured, Round, Said
from srprov.probing.pairs import asked, pairs_of
from srprov.probing.request import request_of
from srprov.probing.verdict import JUDGES, Probed
from tests.bounded import within
from tests.unit.probing.worlds import GOOD, NOTHING, RECORD, ROBOTS, between, both, look, request, round_of, with_link

SMALL_ONLY = replace(GOOD, fits=1322)
NO_TCP = replace(GOOD, tcp=False, tcp_error=110)
HEARD = replace(NOTHING, heard=True)


def causes(
    changes: dict[tuple[str, str], Measured], looks: dict[str, Look] | None = None, dropped: Any = None, tunnel: int = 0
) -> tuple[Cause, ...]:
    found = round_of(changes, tunnel)
    seen = {**{robot: look(robot) for robot in ROBOTS}, **(looks or {})}
    return judged(Evidence(found=found, pairs=pairs_of(found), looks=seen, dropped=dropped or {}), JUDGES)


def names(cause: Cause) -> set[tuple[str, ...]]:
    return {one.names for one in cause.pairs}


def named(changes: dict[tuple[str, str], Measured]) -> set[tuple[str, ...]]:
    shown = {"s1": "s1@r1", "s2": "s2@r2", "s3": "s3@r3"}
    return {(shown.get(a, a), shown.get(b, b)) for a, b in changes if not a.startswith("u")}


def inside(robot: str, **neighbours: str) -> Look:
    seen = look(robot)
    at, one = next(iter(seen.inside.items()))
    return replace(seen, inside={at: replace(one, neighbours=neighbours)})


def test_nothing_fails_and_nothing_is_named() -> None:
    assert causes({}) == ()


def one_way_changes() -> dict[tuple[str, str], Measured]:
    """r1 hears r2, and r2 hears nothing of r1."""
    changes = between("1", "2")
    return {(a, b): HEARD if a.endswith("1") else NOTHING for a, b in changes}


ON_THE_WAY: dict[str, tuple[dict[tuple[str, str], Measured], str, tuple[str, ...]]] = {
    "underlay": ({**between("1", "2"), **both("u1", "u2")}, "underlay", ("r1 - r2", "in both directions")),
    "one way": (one_way_changes(), "port", ("r1 - r2", "UDP port 4789", "from r1 to r2")),
    "both ways": (between("2", "3"), "port", ("r2 - r3", "in both directions")),
    "nat": (
        {**between("1", "3"), ("u1", "u3"): replace(GOOD, source="198.51.100.7")},
        "nat",
        ("r1 - r3", "packets of r3 come to r1 from 198.51.100.7, not from 192.0.2.3"),
    ),
    "path mtu": (
        {**between("1", "2", SMALL_ONLY), **both("u1", "u2", replace(GOOD, fits=1372))},
        "mtu",
        ("r1 - r2", "at most 1372 bytes, and 1500 are needed", "more than 1322"),
    ),
    "checksum": (both("s1", "s2", NO_TCP), "checksum", ("r1 - r2", "TCP")),
    "multicast": (both("s1", "s3", replace(GOOD, multicast=False)), "multicast", ("r1 - r3",)),
}


@pytest.mark.parametrize("name", ON_THE_WAY)
def test_what_is_wrong_on_the_way_is_told_by_what_gets_through(name: str) -> None:
    changes, kind, words = ON_THE_WAY[name]
    (cause,) = causes(changes)
    assert (cause.kind, names(cause)) == (kind, named(changes))
    assert all(word in cause.text for word in words), cause.text
    assert cause.hint


def all_of(robot: str) -> dict[tuple[str, str], Measured]:
    n = robot[1:]
    return {key: value for m in "123" if m != n for key, value in between(n, m).items()}


def test_a_link_that_is_down_names_all_pairs_of_its_robot_once() -> None:
    whole = request()
    for name, change, word in (
        (whole.link, {"up": False}, "is down"),
        (whole.link, {"port_state": "disabled"}, "that is disabled"),
        (whole.link, {"master": ""}, "is not a port of"),
        (whole.bridge, {"up": False}, "is down"),
    ):
        (cause,) = causes(all_of("r2"), {"r2": with_link(look("r2"), name, **change)})
        assert cause.kind == "interface" and word in cause.text and names(cause) == named(all_of("r2"))


def test_a_port_that_is_down_names_the_pairs_of_its_service() -> None:
    changes = {key: value for other in ("r1", "r2", "r3", "s1", "s3") for key, value in both("s2", other).items()}
    (cause,) = causes(changes, {"r2": with_link(look("r2"), "veth1", up=False)})
    assert (cause.kind, names(cause)) == ("interface", named(changes))
    assert "veth1 is down" in cause.text and "s2" in cause.text


def test_a_wrong_arp_entry_is_named_with_both_macs() -> None:
    changes = both("s1", "s2")
    (cause,) = causes(changes, {"r1": inside("r1", **{"10.128.1.2": "02:de:ad:be:ef:01"})})
    assert (cause.kind, names(cause)) == ("arp", named(changes))
    assert "02:de:ad:be:ef:01" in cause.text and "02:00:00:00:00:02" in cause.text


def test_right_arp_entries_are_no_cause() -> None:
    (cause,) = causes(both("s1", "s2"), {"r1": inside("r1", **{"10.128.1.2": "02:00:00:00:00:02"})})
    assert cause.kind == "port"


def without(robot: str, *entries: tuple[str, str]) -> Look:
    seen = look(robot)
    assert seen.fdb is not None
    return replace(seen, fdb=seen.fdb - set(entries))


def test_a_missing_entry_for_everybody_names_the_two_robots() -> None:
    (cause,) = causes(between("1", "3"), {"r1": without("r1", ("00:00:00:00:00:00", "192.0.2.3"))})
    assert (cause.kind, names(cause)) == ("fdb", named(between("1", "3")))


def test_a_missing_entry_of_a_service_is_named_although_its_frames_get_through() -> None:
    (cause,) = causes({}, {"r1": without("r1", ("02:00:00:00:00:03", "192.0.2.3"))})
    assert (cause.kind, cause.pairs) == ("fdb", ())
    assert "s3@r3" in cause.text and "go to every robot" in cause.text


def test_an_entry_that_leads_elsewhere_names_the_pairs_of_its_service() -> None:
    right, wrong = ("02:00:00:00:00:03", "192.0.2.3"), ("02:00:00:00:00:03", "192.0.2.2")
    changes = {**both("s1", "s3"), **both("r1", "s3")}
    seen = without("r1", right)
    assert seen.fdb is not None
    (cause,) = causes(changes, {"r1": replace(seen, fdb=seen.fdb | {wrong})})
    assert (cause.kind, names(cause)) == ("fdb", named(changes))
    assert "leads to 192.0.2.2" in cause.text


def test_a_rule_that_dropped_is_named_before_what_the_pattern_would_say() -> None:
    rule = Rule(where="iptables filter INPUT", words="-s 192.0.2.1/32 -p udp -m udp --dport 4789 -j DROP", packets=9)
    (cause,) = causes(one_way_changes(), dropped={"r2": [rule]})
    assert (cause.kind, names(cause)) == ("firewall", named(one_way_changes()))
    assert rule.words in cause.text and "r2" in cause.text


def test_a_rule_that_cannot_have_met_these_packets_is_not_named() -> None:
    for words in ("-s 203.0.113.0/24 -j DROP", "-p tcp -m tcp --dport 22 -j DROP", "! -s 0.0.0.0/0 -j DROP"):
        rule = Rule(where="iptables filter INPUT", words=words, packets=9)
        (cause,) = causes(between("1", "2"), dropped={"r2": [rule]})
        assert cause.kind == "port", words


def test_a_lowered_mtu_of_a_robot_is_named_with_its_link() -> None:
    changes = {
        key: SMALL_ONLY for other in "12" for key in between("3", other)
    } | both("u3", "u1", replace(GOOD, fits=1372))  # fmt: skip
    (cause,) = causes(changes, {"r3": with_link(look("r3"), "eth0", mtu=1400)})
    assert (cause.kind, names(cause)) == ("mtu", named(changes))
    assert "MTU of eth0 is 1400, and 1500 are needed" in cause.text


def test_two_faults_at_once_keep_their_own_pairs() -> None:
    changes = {**between("1", "2"), **both("u1", "u2"), **both("s2", "s3", NO_TCP)}
    first, second = causes(changes)
    assert (first.kind, second.kind) == ("underlay", "checksum")
    assert names(first) | names(second) == named(changes) and not names(first) & names(second)


def test_a_robot_that_was_not_looked_at_still_has_causes() -> None:
    """It went away meanwhile, or says nonsense."""
    assert next(one.kind for one in causes(all_of("r3"), {"r3": Look()})) == "interface"
    assert causes(both("s1", "s2"), {"r1": Look(host=Inside())})


def test_the_json_of_a_cause_names_robots_services_and_pairs() -> None:
    (cause,) = causes(both("s1", "s2", NO_TCP))
    said = cause_json(cause)
    assert (said["robots"], said["services"]) == (["r1", "r2"], ["s1", "s2"])
    assert said["pairs"] == [["s1@r1", "s2@r2"], ["s2@r2", "s1@r1"]]


def encrypted(robot: str, **tunnel: Any) -> Look:
    """Return what is there when an encrypted overlay is right, but for its WireGuard interface."""
    seen = with_link(look(robot), "eth0", mtu=1576)
    entries = frozenset((mac, vtep.replace("192.0.2.", "10.128.0.")) for mac, vtep in seen.fdb or ())
    return replace(seen, fdb=entries, tunnel=Inside(links=(LinkSeen(name="srpw00000001a", **tunnel),)))


def test_an_encrypted_overlay_is_told_by_its_own_port_and_size() -> None:
    """WireGuard's port is what a firewall must let pass, and its bytes are needed too."""
    right = {robot: encrypted(robot) for robot in ROBOTS}
    assert causes({}, right, tunnel=20001) == ()

    (cause,) = causes(between("1", "2"), right, tunnel=20001)
    assert (cause.kind, names(cause)) == ("port", named(between("1", "2")))
    assert "UDP port 20001" in cause.text and "in one direction at least" in cause.text
    assert "20001" in cause.hint and "4789" not in cause.text + cause.hint

    rule = Rule(where="iptables filter INPUT", words="-p udp -m udp --dport 20001 -j DROP", packets=9)
    (cause,) = causes(between("1", "2"), right, dropped={"r2": [rule]}, tunnel=20001)
    assert cause.kind == "firewall" and rule.words in cause.text

    small = {key: SMALL_ONLY for other in "12" for key in between("3", other)}
    (cause,) = causes(small, {**right, "r3": with_link(encrypted("r3"), "eth0", mtu=1550)}, tunnel=20001)
    assert cause.kind == "mtu" and "MTU of eth0 is 1550, and 1576 are needed" in cause.text

    (cause,) = causes({}, {**right, "r1": look("r1")}, tunnel=20001)[:1]
    assert cause.kind == "fdb", "entries that lead past the tunnel"


@pytest.mark.parametrize(
    ("seen", "word"),
    [
        (encrypted("r2", up=False), "the WireGuard interface srpw00000001a is down"),
        (replace(encrypted("r2"), tunnel=Inside()), "WireGuard interface, which encrypts the overlay, is not there"),
        (replace(encrypted("r2"), tunnel=None), "is not there"),
    ],
)
def test_a_robot_that_lost_what_encrypts_is_named(seen: Look, word: str) -> None:
    right = {robot: encrypted(robot) for robot in ROBOTS}
    (cause,) = causes(all_of("r2"), {**right, "r2": seen}, tunnel=20001)
    assert (cause.kind, names(cause)) == ("interface", named(all_of("r2"))) and word in cause.text


def test_a_robot_that_shows_other_entries_speaks_for_itself_alone() -> None:
    """It leads its own to the others' gateways, as if all was encrypted: the others' entries are right."""
    liar = encrypted("r1")
    found = causes({}, {"r1": liar})
    assert found and {one.text.split(" - ")[0] for one in found} == {"r1"}


def test_what_a_robot_shows_costs_little() -> None:
    """Of twelve robots with ten services each, one has all pairs fail, its entries wrong, and a thousand rules."""
    robots = [f"r{n}" for n in range(12)]
    services = {
        f"s{n}-{k}": {"ip": f"10.128.{n + 1}.{k}", "mac": f"02:00:00:00:{n:02x}:{k:02x}", "network": "overlay",
                      "robot": robot}
        for n, robot in enumerate(robots) for k in range(10)
    }  # fmt: skip
    ends = {one: {"gateway": f"10.128.0.{n + 1}", "vtep": f"192.0.2.{n + 1}"} for n, one in enumerate(robots)}
    whole = request_of("i", {**RECORD, "robots": ends, "services": services})
    assert whole is not None
    every = whole.endpoints
    said = {
        at: Said(
            peers={
                other: NOTHING if "r0" in (one.robot, to.robot) else GOOD
                for other, to in enumerate(every)
                if other != at and asked(one, to)
            }
        )
        for at, one in enumerate(every)
    }
    neighbours = {one.address: "0a:00:00:00:00:00" for one in every}
    shown = tuple(
        LinkSeen(name=name, master=whole.bridge if name == whole.link else "") for name in (whole.bridge, whole.link)
    )
    looks = {one: Look(host=Inside(links=shown)) for one in robots}
    words = "-s 198.51.100.{}/32 -p udp -m comment --comment 'rule {}' -j DROP"
    rules = [Rule(where="iptables raw X", words=words.format(n % 250, n), packets=0) for n in range(1000)]
    entries = frozenset((f"0a:00:00:00:{n >> 8:02x}:{n & 255:02x}", "192.0.2.9") for n in range(8000))
    looks["r0"] = Look(host=Inside(links=shown, neighbours=neighbours), fdb=entries, rules=tuple(rules))
    after = {**looks, "r0": replace(looks["r0"], rules=tuple(replace(one, packets=1) for one in rules))}
    judge = Probed(found=Round(request=whole, said=said), before=looks, after=after)
    with within(8):
        assert judge.causes
        # seconds of this process: minutes before what is looked up was put in order
