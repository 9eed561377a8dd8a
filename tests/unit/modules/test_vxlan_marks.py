"""What one instance lets in is of no use to another one on the same robot, and comes to the VTEP alone."""

from __future__ import annotations

import hashlib
import re

from srprov.modules.vxlan_rules import Filter, closing


def rules(vni: int, local: str = "192.0.2.1", peer: str = "192.0.2.2") -> str:
    mark, six = "srprov:hello:srpv00000001:00000000", ":" in local
    one = Filter(
        name="srpv00000001", label=mark, hash="00000000", vni=vni, port=4789, local=local, peers=(peer,), six=six
    )
    return closing(one, ())


def test_each_instance_marks_what_it_lets_in_with_a_mark_of_its_own() -> None:
    """A large packet has one mark for all of its segments, of whatever instances they are."""
    every = set()
    for vni in (1, 2, 0xFFFFFF):
        arriving, _, unpacked = rules(vni).partition("table bridge srpv00000001 {")
        (mark,) = set(re.findall(r"meta mark set (\S+)", arriving))
        assert re.findall(r"meta mark != (\S+) counter drop", unpacked) == [mark]
        every.add(mark)
    assert len(every) == 3


def test_only_what_is_sent_to_the_vtep_is_let_in() -> None:
    """A container's gateway is an address of the robot, too, and leads to the same socket."""
    for local, peer, ip in (("192.0.2.1", "192.0.2.2", "ip"), ("2001:db8::1", "2001:db8::2", "ip6")):
        lines = rules(7, local, peer).splitlines()
        let_in = [line for line in lines if "meta mark set 0x53" in line]
        assert len(let_in) == 2 and all(f" {ip} daddr {local} {ip} saddr " in line for line in let_in)
        returned = [line for line in lines if line.startswith("-A srpv00000001-in ") and line.endswith("RETURN")]
        assert len(returned) == 1 and f" -d {local} " in returned[0]


def test_what_members_send_is_not_tracked() -> None:
    """A container that sends from the overlay's port to a member's would be handed what that member sends."""
    for local, peer, ip in (("192.0.2.1", "192.0.2.2", "ip"), ("2001:db8::1", "2001:db8::2", "ip6")):
        lines = [line.strip() for line in rules(7, local, peer).splitlines()]
        (early,) = [at for at, line in enumerate(lines) if "notrack comment" in line]
        assert lines[early - 1] == "type filter hook prerouting priority -300; policy accept;", "conntrack's is -200"
        assert (
            f"udp sport 768-1023 udp dport 4789 @th,96,24 7 {ip} daddr {local} {ip} saddr {{ {peer} }} " in lines[early]
        )
        chain = [line for line in lines if line.startswith("-A srpv00000001-in ")]
        ends = [line.rpartition(" -j ")[2] for line in chain]
        assert ends[-3:] == ["CT --notrack", "RETURN", "DROP"], "all that is let in"


def test_rules_that_say_something_else_are_told_apart_by_their_hash() -> None:
    """Robots that have the rules of an older version are right by their hash, and would keep them for ever.

    Where this fails: put another word into what `_filter` of vxlan_filter.py hashes, and the new digests here.
    """
    every = [hashlib.sha256(rules(7, *two).encode()).hexdigest()[:8] for two in ((), ("2001:db8::1", "2001:db8::2"))]
    assert every == ["e028dce0", "e2b330b7"]
