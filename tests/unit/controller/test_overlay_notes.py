"""A plan says why all containers of an overlay are made anew, and who gets a subnet by the word of another robot."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from srprov.controller.overlay_notes import overlay_notes
from srprov.definitions.model import NetworkSettings
from srprov.facts.model import Snapshot
from srprov.network.layout import layout
from srprov.resource import Observed
from tests.unit.assignment.worlds import experiment, found, robot, service
from tests.unit.network.test_identity import HELLO, NO_WISH, network

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
    mine = Observed(module="network", name=overlay.network, instance="hello", state={"mtu": before, "subnet": ""})
    theirs = Observed(module="network", name="srprov.theirs", instance="theirs", state={"mtu": 1200})
    there = replace(snapshot, observed={"r1": (mine, theirs), "r2": ()})
    notes = overlay_notes(overlay, there, WHAT)
    assert len(notes) == (1 if words else 0)
    assert all(word in notes[0] for word in words), notes


SAID = network("hello", subnet="10.200.0.0/20", vni=1234567, port=4789, mtu=1450)


def noted(there: Snapshot, settings: NetworkSettings = NO_WISH) -> tuple[str, ...]:
    what = replace(WHAT, network=settings)
    return overlay_notes(layout(what, PLACED, there, instance="hello"), there, what)


def with_route(network: str) -> Snapshot:
    ends = (robot("r1", underlay_address="192.0.2.1", routes=(network,)), robot("r2", underlay_address="192.0.2.2"))
    return found(*ends)


def test_a_subnet_that_one_robot_says_is_told_where_it_is_new() -> None:
    """Root there chose it: what r2 had reached in it by its default route went to whoever took the address."""
    lying = replace(lab(1500), observed={"r1": (SAID,), "r2": ()})
    (note,) = noted(lying)
    assert note.startswith(f"the overlay takes 10.200.0.0/20 on r2, and not {HELLO.subnet} as by its name: ")
    assert "the instance has that on r1" in note
    assert noted(replace(lying, observed={"r1": (SAID,), "r2": (SAID,)})) == (), "it is new nowhere"
    assert noted(lying, NetworkSettings(subnet="10.200.0.0/20")) == (), "the EDF says so"
    other = network("hello", subnet="10.201.0.0/20", vni=1234567, port=4789, mtu=1450)
    overlay = layout(WHAT, PLACED, lying, instance="hello")
    assert overlay_notes(overlay, replace(lying, observed={"r1": (SAID,), "r2": (other,)}), WHAT) == (note,)


def test_a_subnet_that_gives_way_to_what_a_robot_says_is_told() -> None:
    (note,) = noted(with_route(str(HELLO.subnet)))
    assert f"that one is taken by the route to {HELLO.subnet} on r1" in note and " on r1, r2, " in note


@pytest.mark.parametrize("there", [lab(1500), with_route("10.1.0.0/16")])
def test_of_the_usual_subnet_nothing_is_said(there: Snapshot) -> None:
    assert noted(there) == ()
