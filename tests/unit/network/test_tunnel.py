"""What an encrypted overlay is: who is sent to where, which interface and port, and what its MTU leaves free."""

from __future__ import annotations

from typing import Any

import pytest
from msgspec.structs import replace

from srprov.definitions.model import NetworkSettings
from srprov.errors import UsageError
from srprov.facts.model import Snapshot, TakenPort
from srprov.network.identity import number, tunnel_name
from srprov.network.layout import layout
from srprov.network.model import Overlay, Tunnel
from srprov.resource import Observed
from tests.unit.network.test_layout import PLACED, lab, three

HIDDEN = NetworkSettings(encryption="wireguard")
INSTANCE = "experiment"


def made(snapshot: Snapshot | None = None, *, rotate: bool = False, **network: Any) -> Overlay:
    settings = replace(HIDDEN, **network)
    return layout(three(network=settings), PLACED, snapshot or lab(), instance=INSTANCE, rotate=rotate)


def tunnel(snapshot: Snapshot | None = None, **more: Any) -> Tunnel:
    found = made(snapshot, **more).tunnel
    assert found is not None
    return found


def having(snapshot: Snapshot, instance: str = INSTANCE, **slots: str) -> Snapshot:
    """Return a lab whose robots have interfaces of an instance: `a`, `b`, or both, the one that is used first."""
    netns, base = tunnel_name(instance), tunnel_base(instance)
    seen = {
        robot: (
            *(
                Observed(module="wireguard", name=netns + one, instance=instance,
                         state={"listen_port": base + "ab".index(one)})
                for one in letters
            ),
            Observed(module="wireguard_routes", name=netns, instance="", state={"through": {"x": netns + letters[0]}}),
        )
        for robot, letters in slots.items()
    }  # fmt: skip
    observed = {robot: (*snapshot.observed.get(robot, ()), *seen.get(robot, ())) for robot in snapshot.facts}
    return replace(snapshot, observed=observed)


def tunnel_base(instance: str) -> int:
    """Return the first port as the manual says it."""
    return 20_000 + 2 * (number("wireguard", instance) % 5000)


def test_packets_go_to_addresses_inside_of_the_tunnel() -> None:
    overlay = made()
    assert overlay.tunnel is not None
    assert overlay.flood["r1"] == tuple(sorted(overlay.gateways[one] for one in ("r2", "r3")))
    assert {end for _, end in overlay.fdb["r1"]} == {overlay.gateways["r2"], overlay.gateways["r3"]}
    assert overlay.tunnel.endpoints["r2"] == f"192.168.0.2:{tunnel_base(INSTANCE)}"
    assert overlay.tunnel.interface == f"{tunnel_name(INSTANCE)}a"


@pytest.mark.parametrize(("addresses", "mtu"), [("192.168.0.{}", 1500 - 126), ("2001:db8::{}", 1500 - 146)])
def test_the_mtu_leaves_room_for_wireguard_its_padding_and_vxlan(addresses: str, mtu: int) -> None:
    robots = {f"r{n}": {"underlay_address": addresses.format(n)} for n in (1, 2, 3)}
    overlay = made(lab(**robots))
    assert overlay.mtu == mtu
    assert overlay.tunnel is not None
    assert overlay.tunnel.mtu == mtu + 50
    assert overlay.tunnel.endpoints["r1"] == (f"[{robots['r1']['underlay_address']}]" if "::" in addresses else
        robots["r1"]["underlay_address"]) + f":{overlay.tunnel.port}"  # fmt: skip
    with pytest.raises(UsageError, match=f"leaves: {mtu}"):
        made(lab(**robots), mtu=mtu + 1)


def test_the_interface_stays_and_rotation_takes_the_other_one() -> None:
    used = having(lab(), r1="b", r2="b", r3="b")
    assert tunnel(used).interface[-1] == "b"
    assert tunnel(used, rotate=True).interface[-1] == "a"
    assert tunnel(used, rotate=True).port == tunnel(used).port - 1
    assert tunnel(rotate=True).interface[-1] == "a"


@pytest.mark.parametrize(
    ("slots", "stays"),
    [
        ({"r1": "ab", "r2": "ab", "r3": "a"}, "a"),
        ({"r1": "ba", "r2": "ab", "r3": "ba"}, "b"),
        ({"r1": "b", "r2": "ba", "r3": "ba"}, "b"),
        ({"r1": "b"}, "b"),
    ],
)
def test_a_rotation_that_was_cut_off_is_ended_where_most_robots_are(slots: dict[str, str], stays: str) -> None:
    assert tunnel(having(lab(), **slots)).interface[-1] == stays


def test_keys_are_not_rotated_without_all_members_nor_without_encryption() -> None:
    away = replace(lab(), unreachable={"r3": "gone"})
    away = replace(away, facts={name: one for name, one in away.facts.items() if name != "r3"},
                               placements={INSTANCE: {"robots": {"r3": {"vtep": "192.168.0.3"}}}})  # fmt: skip
    with pytest.raises(UsageError, match="r3 cannot be reached"):
        made(away, rotate=True)
    assert tunnel(away).endpoints.keys() == {"r1", "r2", "r3"}
    with pytest.raises(UsageError, match="not encrypted"):
        layout(three(), PLACED, lab(), instance=INSTANCE, rotate=True)


def test_a_port_that_somebody_has_is_passed_over_and_ones_own_stays() -> None:
    base = tunnel_base(INSTANCE)
    assert tunnel().port == base
    held = TakenPort(address="", port=base + 1, protocol="udp", by="a program")
    assert tunnel(replace(lab(), taken={"r2": (held,)})).port == base + 2
    assert tunnel(replace(having(lab(), r1="a"), taken={"r2": (held,)})).port == base
    tcp = replace(held, protocol="tcp")
    assert tunnel(replace(lab(), taken={"r2": (tcp,)})).port == base


def test_what_robots_say_of_ports_leads_nowhere_strange() -> None:
    """A robot that says a port of the system for its own interface does not have others listen there."""
    liar = Observed(module="wireguard", name=f"{tunnel_name(INSTANCE)}a", instance=INSTANCE, state={"listen_port": 53})
    snapshot = replace(lab(), observed={"r1": (liar,), "r2": (), "r3": ()})
    assert tunnel(snapshot).port == tunnel_base(INSTANCE)
