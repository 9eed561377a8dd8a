"""Three robots with a service each, as a probe's request, and rounds in which things fail."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from msgspec.structs import replace

from srprov.probing.look import Inside, LinkSeen, Look
from srprov.probing.model import Measured, Request, Round, Said
from srprov.probing.pairs import asked
from srprov.probing.request import request_of

ROBOTS = ("r1", "r2", "r3")
RECORD: dict[str, Any] = {
    "instance": "i",
    "mtu": 1450,
    "port": 4789,
    "vni": 1234567,
    "subnet": "10.128.0.0/16",
    "robots": {f"r{n}": {"gateway": f"10.128.0.{n}", "vtep": f"192.0.2.{n}"} for n in (1, 2, 3)},
    "services": {
        f"s{n}": {"ip": f"10.128.1.{n}", "mac": f"02:00:00:00:00:0{n}", "network": "overlay", "robot": f"r{n}"}
        for n in (1, 2, 3)
    },
}
GOOD = Measured(sent=5, received=5, rtt_us=(100, 200, 300), heard=True, fits=1600, multicast=True, tcp=True)
NOTHING = Measured(sent=14)


def request(tunnel: int = 0) -> Request:
    made = request_of("i", RECORD, tunnel_port=tunnel)
    assert made is not None
    return made


def round_of(changes: Mapping[tuple[str, str], Measured] | None = None, tunnel: int = 0) -> Round:
    """Return a round in which all works but what is changed: (who says it, of whom) by their names.

    A robot's two addresses are `r1` on the overlay and `u1` on the underlay.
    """
    changes, whole = changes or {}, request(tunnel)
    names = {at: name_of(whole, at) for at in range(len(whole.endpoints))}
    said = {}
    for at, one in enumerate(whole.endpoints):
        peers = {
            other: changes.get((names[at], names[other]), GOOD)
            for other, target in enumerate(whole.endpoints)
            if other != at and asked(one, target)
        }
        said[at] = Said(peers=peers)
    inside = {at: 100 + at for at, one in enumerate(whole.endpoints) if one.container}
    return Round(request=whole, said=said, namespaces=inside)


def name_of(whole: Request, at: int) -> str:
    one = whole.endpoints[at]
    return one.service or (one.robot if one.kind == "gateway" else f"u{one.robot[1:]}")


def both(one: str, other: str, measured: Measured = NOTHING) -> dict[tuple[str, str], Measured]:
    return {(one, other): measured, (other, one): measured}


def between(one: str, other: str, measured: Measured = NOTHING) -> dict[tuple[str, str], Measured]:
    """Return that all overlay pairs between two robots have failed."""
    ends = [(f"r{one}", f"s{one}"), (f"r{other}", f"s{other}")]
    return {key: value for a in ends[0] for b in ends[1] for key, value in both(a, b, measured).items()}


def look(robot: str) -> Look:
    """Return what is there when everything is right."""
    whole, n = request(), robot[1:]
    others = [m for m in "123" if m != n]
    entries = {("00:00:00:00:00:00", f"192.0.2.{m}") for m in others}
    entries |= {(f"02:00:00:00:00:0{m}", f"192.0.2.{m}") for m in others}
    own = next(at for at, one in enumerate(whole.endpoints) if one.service == f"s{n}")
    return Look(
        host=Inside(
            links=(
                LinkSeen(name="eth0", index=2, mtu=1500, addresses=(f"192.0.2.{n}",)),
                LinkSeen(name=whole.bridge, index=3, mtu=1450, mac=f"02:b0:00:00:00:0{n}",
                         addresses=(f"10.128.0.{n}",)),
                LinkSeen(name=whole.link, index=4, mtu=1450, master=whole.bridge, port_state="forwarding"),
                LinkSeen(name="veth1", index=5, mtu=1450, master=whole.bridge, port_state="forwarding"),
            ),
        ),
        inside={
            own: Inside(
                links=(LinkSeen(name="eth0", index=7, peer=5, mtu=1450, mac=f"02:00:00:00:00:0{n}",
                                addresses=(f"10.128.1.{n}",)),),
            )
        },
        fdb=frozenset(entries),
    )  # fmt: skip


def with_link(seen: Look, name: str, **changes: Any) -> Look:
    links = tuple(replace(one, **changes) if one.name == name else one for one in seen.host.links)
    return replace(seen, host=replace(seen.host, links=links))
