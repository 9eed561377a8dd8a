"""A plan says why all containers of an overlay are made anew."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from srprov.controller.mtu_note import mtu_notes
from srprov.facts.model import Snapshot
from srprov.network.layout import layout
from srprov.resource import Observed
from tests.unit.assignment.worlds import experiment, found, robot, service

PLACED = {"one": "r1", "two": "r2"}
WHAT = experiment(service("one"), service("two"))


def lab(mtu: int) -> Snapshot:
    ends = {"r1": 1500, "r2": mtu}
    return found(*(robot(n, underlay_address=f"192.0.2.{n[1]}", underlay_mtu=ends[n]) for n in ends))


@pytest.mark.parametrize(
    ("before", "now", "words"),
    [
        (1450, 1500, ()),
        (0, 1400, ()),
        (1450, 1400, ("is 1450 and becomes 1350", "as r2's link carries 1400 bytes", "made anew on all robots")),
        (1300, 1500, ()),
        (8950, 9000, ("is 8950 and becomes 1450", "as r1's link carries 1500 bytes")),
    ],
)
def test_another_mtu_is_said_with_the_robot_that_asks_for_it(before: int, now: int, words: tuple[str, ...]) -> None:
    snapshot = lab(now)
    overlay = layout(WHAT, PLACED, snapshot)
    mine = Observed(module="network", name=overlay.network, instance="hello", state={"mtu": before})
    theirs = Observed(module="network", name="srprov.theirs", instance="theirs", state={"mtu": 1200})
    notes = mtu_notes(overlay, replace(snapshot, observed={"r1": (mine, theirs), "r2": ()}))
    assert len(notes) == (1 if words else 0)
    assert all(word in notes[0] for word in words), notes
