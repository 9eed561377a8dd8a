"""What one instance lets in is of no use to another one on the same robot."""

from __future__ import annotations

import re

from srprov.modules.vxlan_rules import Filter, closing


def marks(vni: int) -> tuple[set[str], set[str]]:
    """Give the marks that an instance's rules set on what they let in, and those that its link wants."""
    text = closing(
        Filter(name="srpv00000001", label="srprov:hello:srpv00000001:00000000", hash="00000000", vni=vni, port=4789,
               peers=("192.0.2.2",), six=False), ()
    )  # fmt: skip
    arriving, _, unpacked = text.partition("table bridge srpv00000001 {")
    wanted = re.findall(r"meta mark != (\S+) counter drop", unpacked)
    return set(re.findall(r"meta mark set (\S+)", arriving)), set(wanted)


def test_each_instance_marks_what_it_lets_in_with_a_mark_of_its_own() -> None:
    """A large packet has one mark for all of its segments, of whatever instances they are."""
    given = [marks(vni) for vni in (1, 2, 0xFFFFFF)]
    assert all(let_in == wanted and len(wanted) == 1 for let_in, wanted in given)
    assert len({one for let_in, _ in given for one in let_in}) == len(given)
