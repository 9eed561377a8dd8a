"""What a robot says is read in time that grows with its length, whatever it says: it keeps no other robot waiting."""

from __future__ import annotations

import json
from collections.abc import Sequence

import pytest

from srprov.definitions.model import Host, NetworkSettings
from srprov.errors import UsageError
from srprov.facts.host import parse_host
from srprov.facts.model import Snapshot
from srprov.facts.probes import EMULATORS
from srprov.modules import MODULES
from srprov.network.identity import identify
from srprov.wire import Reply
from tests.bounded import bounded
from tests.unit.facts.robot_outputs import COMPUTER, replies

MANY = 20_000
LINK = {"linkinfo": {"info_kind": "vxlan"}}


def links(*more: dict[str, object], name: str = "srpv{}", count: int = MANY) -> str:
    """Return what `ip` says of many VXLAN links."""
    return json.dumps([*more, *({**LINK, "ifname": name.format(n), "master": "srpb1"} for n in range(count))])


BRIDGE = {"ifname": "srpb1", "linkinfo": {"info_kind": "bridge"}, "addr_info": [{"local": "10.0.0.1"}] * MANY}
ENTRIES = json.dumps([{"ifname": f"srpv{n}", "mac": "0", "dst": "1"} for n in range(MANY)])
ONE_LINKS = json.dumps([{"ifname": "srpv1", "mac": "0", "dst": "1"}] * MANY)


@pytest.mark.parametrize(
    ("kind", "said", "most"),
    [
        pytest.param("vxlan", [links(), ENTRIES], MANY, id="as many entries as links"),
        pytest.param("vxlan", [links(name="srpv1"), ONE_LINKS], 1, id="one name of all links and entries"),
        pytest.param("vxlan", [links(BRIDGE), "[]"], MANY, id="one bridge of all links, with many addresses"),
        pytest.param("wireguard", ["[]", "netns srpw12345678\nshow endpoints\n" + "\t" * 400_000], 1, id="empty words"),
    ],
)
def test_things_without_end_are_read_in_time(kind: str, said: Sequence[str], most: int) -> None:
    """Not every pair of two lists is looked at, nor every word again for each word."""
    answers = [Reply(status=200, out=one) for one in said]
    assert 0 < len(bounded(lambda: [one.name for one in MODULES[kind].parse(answers)])) <= most


def test_flags_of_an_emulator_are_read_in_time() -> None:
    """Each line could be taken apart in thousands of ways."""
    path = next(iter(EMULATORS))
    lines = [f"{path}:enabled", *[f"{path}:flags: {'F' * 4000}1"] * 500]
    said = replies({**COMPUTER, "files": "\n".join(lines)})
    assert bounded(lambda: parse_host(Host(name="r", address="r"), said, None).emulates) == ()


def test_what_is_no_number_where_the_kernel_has_one_counts_as_none() -> None:
    """A plan tells what a link has: not megabytes, and no lists."""
    odd = {
        "ifname": "srpv1",
        "mtu": "x" * 9999,
        "linkinfo": {"info_kind": "vxlan", "info_data": {"id": [1], "port": {}}},
    }
    (found,) = MODULES["vxlan"].parse([Reply(status=0, out=json.dumps([odd])), Reply(status=0, out="[]")])
    assert (found.state["mtu"], found.state["vni"], found.state["port"]) == (0, 0, 0)


def test_addresses_without_end_do_not_make_the_choice_of_a_subnet_long() -> None:
    """Each of 2048 subnets is looked for in what robots have; and a robot may say that it has all of them."""
    said = [{"local": f"10.{128 + n // 65536}.{n // 256 % 256}.{n % 256}", "prefixlen": 32} for n in range(1000)]
    links = json.dumps([{"ifname": f"e{n}", "flags": ["UP"], "addr_info": said} for n in range(100)])
    routes = json.dumps([{"dst": "10.128.0.0/9", "dev": "e0"}])
    answers = replies({**COMPUTER, "links": links, "routes": routes})

    def chosen() -> str:
        facts = {f"r{n}": parse_host(Host(name=f"r{n}", address="x"), answers, None) for n in range(2)}
        assert max(sum(len(link.addresses) for link in one.links) for one in facts.values()) == 4096
        snapshot = Snapshot(facts=facts, observed={name: () for name in facts}, unreachable={}, records={})
        try:
            return str(identify("hello", NetworkSettings(), snapshot).subnet)
        except UsageError as error:
            return error.message

    assert "no /20 of 10.128.0.0/9 is free" in bounded(chosen)
