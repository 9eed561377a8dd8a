"""What a robot's program says is read within limits, and about that robot alone."""

from __future__ import annotations

import json

import pytest

from srprov.probing.answers import parse_said
from srprov.probing.firewall import Packet, Rule, may_match, parse_rules, that_dropped
from srprov.probing.look import Look, parse_look, queries
from srprov.probing.model import Measured
from srprov.wire import Reply
from tests.unit.probing.worlds import name_of, request

WHOLE = request()
AT = {name_of(WHOLE, at): at for at in range(len(WHOLE.endpoints))}


def line(name: str, *peers: list[object], **more: object) -> str:
    return json.dumps({"self": AT[name], "ms": 3, "failed": "", "error": 0, "peers": list(peers), **more})


def test_a_line_is_read() -> None:
    row = [AT["s2"], 5, 4, 10, 20, 30, 1, 1450, 0, 1, 1, 0, 0, 0, ""]
    said = parse_said(line("s1", row), WHOLE, "r1")
    assert said[AT["s1"]].peers == {
        AT["s2"]: Measured(
            sent=5, received=4, rtt_us=(10, 20, 30), heard=True, fits=1450, multicast=True, tcp=True
        )
    }  # fmt: skip


def test_a_robot_speaks_for_its_own_endpoints_alone() -> None:
    assert parse_said(line("s2") + "\n" + line("r1"), WHOLE, "r1").keys() == {AT["r1"]}


@pytest.mark.parametrize(
    "out",
    [
        "",
        "\0\0",
        "[]",
        "{" * 100_000,
        '{"self": true}',
        '{"self": -1}',
        '{"self": 99999999999999999999}',
        '{"self": "0", "peers": {"a": 1}}',
        json.dumps({"self": 0, "failed": ["x"], "error": "y", "peers": [[0], 3, None, [{}] * 15, ["1"] * 15]}),
        json.dumps({"self": 0, "peers": [[1, -5, 2**70, 1e300, None, "x", [], {}, -1, 2, 3, 4, 5, 6, "\x1b[2J"]]}),
        "\n".join([line("r1")] * 10_000),
    ],
)
def test_nonsense_is_bounded(out: str) -> None:
    for one in parse_said(out, WHOLE, "r1").values():
        for measured in one.peers.values():
            assert 0 <= measured.received <= measured.sent <= 1000
            assert measured.source == "" and measured.fits <= 65535 and measured.unreachable <= 256


SAVED = """\
## iptables-save
# Generated
*filter
:INPUT DROP [{policy}:4000]
:FORWARD ACCEPT [0:0]
[7:420] -A INPUT -s 192.0.2.1/32 -p udp -m udp --dport 4789 -m comment --comment "mine" -j DROP
[3:100] -A FORWARD -i srpb -j ACCEPT
[{rejected}:100] -A FORWARD -d 10.128.1.2/32 -j REJECT --reject-with icmp-port-unreachable
COMMIT
## nft
table ip filter {{
    chain INPUT {{
        counter packets 7 bytes 420 drop
    }}
}}
table inet mine {{
    chain in {{
        type filter hook input priority filter; policy drop;
        ip saddr 192.0.2.1 udp dport 4789 counter packets {counted} bytes 900 drop
        ip saddr 192.0.2.9 drop
        accept
    }}
}}
"""


def rules(policy: int = 1, rejected: int = 2, counted: int = 3) -> tuple[Rule, ...]:
    return parse_rules(SAVED.format(policy=policy, rejected=rejected, counted=counted))


def test_rules_that_drop_are_read_with_their_counters() -> None:
    found = {(one.where, one.packets) for one in rules()}
    assert found == {
        ("iptables filter INPUT", 1),
        ("iptables filter INPUT", 7),
        ("iptables filter FORWARD", 2),
        ("nft table inet mine in", None),
        ("nft table inet mine in", 3),
    } | {("nft table inet mine in", None)}
    assert any("192.0.2.9" in one.words for one in rules())


def test_only_rules_whose_counter_rose_met_something() -> None:
    met = that_dropped(rules(), rules(policy=5, rejected=9))
    counted = [one for one in met if one.packets is not None]
    assert [(one.where, bool(one.words)) for one in counted] == [
        ("iptables filter FORWARD", True),
        ("iptables filter INPUT", False),
    ]


@pytest.mark.parametrize("port", ["²", "1:²", "²:9", "٣", "99999999999999999999", "x", "-1", ":"])
def test_a_rule_s_port_may_be_anything(port: str) -> None:
    """What Python takes for a digit is not always a number."""
    (rule,) = parse_rules(f"## iptables-save\n*filter\n[5:100] -A INPUT -p udp --dport {port} -j DROP\n")
    assert not may_match(rule, [Packet(source="10.0.0.1", target="10.0.0.2", protocols=("udp",), port=4789)])


def test_a_look_at_nonsense_is_an_empty_one() -> None:
    asked = queries(WHOLE, "r1", {AT["s1"]: 7})
    assert len(asked) == 6
    for out in ("", "x", "[1, 2]", '[{"ifname": 5, "linkinfo": [], "flags": "UP", "addr_info": {}}]', "[" * 100_000):
        seen = parse_look([Reply(status=0, out=out)] * 6, WHOLE, "r1", {AT["s1"]: 7})
        assert isinstance(seen, Look) and seen.host.by_name("eth0") is None
