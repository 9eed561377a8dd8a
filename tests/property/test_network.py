"""What must hold of every overlay: addresses are unique, stable, and never depend on order or on what robots claim."""

from __future__ import annotations

import json
from collections.abc import Sequence
from ipaddress import IPv4Address, IPv4Network, ip_address
from random import Random

from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from srprov.definitions.model import Experiment, NetworkSettings
from srprov.errors import UsageError
from srprov.facts.model import Link, Snapshot
from srprov.network.addresses import Addresses, allocate
from srprov.network.hosts import HostsFile
from srprov.network.identity import POOL, identify
from srprov.network.layout import layout
from srprov.network.model import Overlay
from srprov.network.record import PlacementRecord, read_record, record
from srprov.resource import Observed
from tests.conftest import examples
from tests.unit.assignment.worlds import experiment, found, robot, service

NAME = st.from_regex(r"[a-z0-9-]{1,8}", fullmatch=True)
# So small that hashes collide all the time.
SUBNET = st.sampled_from([IPv4Network("10.200.0.0/26"), IPv4Network("10.200.16.0/20")])
NAMES = st.lists(NAME, unique=True, max_size=30)
ROBOTS = ("r1", "r2", "r3", "r4")


def as_record(given: Addresses) -> PlacementRecord:
    return PlacementRecord(
        addresses={name: IPv4Address(ip) for name, ip in given.services.items()},
        gateways={name: IPv4Address(ip) for name, ip in given.gateways.items()},
        macs=given.macs,
    )


@settings(deadline=None)
@given(NAME, SUBNET, NAMES, NAMES, st.randoms(use_true_random=False))
def test_addresses_are_unique_and_know_no_order(
    instance: str, subnet: IPv4Network, services: list[str], robots: list[str], random: Random
) -> None:
    addresses = allocate(instance, subnet, services, robots)
    every = [IPv4Address(ip) for ip in (*addresses.services.values(), *addresses.gateways.values())]
    assert len(set(every)) == len(every) == len(services) + len(robots)
    assert all(ip in subnet for ip in every)
    assert not {subnet.network_address, subnet.broadcast_address} & set(every)
    assert len(set(addresses.macs.values())) == len(services)
    assert all(mac.startswith("02:") and len(mac) == 17 for mac in addresses.macs.values())
    for names in (services, robots):
        random.shuffle(names)
    assert repr(allocate(instance, subnet, services, robots)) == repr(addresses)


@settings(deadline=None)
@given(NAME, SUBNET, NAMES, NAMES, NAMES, NAMES)
def test_who_stays_keeps_everything(
    instance: str, subnet: IPv4Network, old: list[str], new: list[str], robots: list[str], others: list[str]
) -> None:
    before = allocate(instance, subnet, old, robots)
    after = allocate(instance, subnet, new, others, as_record(before))
    for name in set(old) & set(new):
        assert after.services[name] == before.services[name]
        assert after.macs[name] == before.macs[name]
    for name in set(robots) & set(others):
        assert after.gateways[name] == before.gateways[name]
    assert len({*after.services.values(), *after.gateways.values()}) == len(new) + len(others)


addresses = st.integers(0, 2**32 - 1).map(lambda value: str(IPv4Address(value)))
routes = st.tuples(addresses, st.integers(0, 32)).map(lambda pair: str(IPv4Network(pair, strict=False)))
near = st.tuples(st.integers(0, 2047), st.integers(9, 32)).map(
    lambda pair: str(IPv4Network((int(POOL.network_address) + (pair[0] << 12), pair[1]), strict=False))
)
links = st.builds(
    Link,
    name=NAME,
    vni=st.integers(0, 0xFFFFFF),
    port=st.sampled_from([4789, 8472]),
    addresses=st.lists(near, max_size=1).map(tuple),
)


@settings(deadline=None)
@given(NAME, st.lists(st.one_of(routes, near), max_size=8), st.lists(links, max_size=4))
def test_a_chosen_identity_meets_nothing_on_any_robot(instance: str, taken: list[str], there: list[Link]) -> None:
    world = found(robot("r1", routes=tuple(taken)), robot("r2", links=tuple(there)))
    claims = [net for net in (IPv4Network(r) for r in taken) if net.prefixlen >= 8]
    claims += [IPv4Network(a, strict=False) for link in there for a in link.addresses]
    try:
        identity = identify(instance, NetworkSettings(), world)
    except UsageError:
        assert any(net.supernet_of(POOL) for net in claims) or sum(net.num_addresses for net in claims) >= 2**23
        return
    assert not any(net.overlaps(identity.subnet) for net in claims)
    assert (identity.vni, identity.port) not in {(link.vni, link.port) for link in there}
    bare = found(robot("r1"))
    used = Observed(module="network", name="n", instance=instance, state={"subnet": str(identity.subnet), "vni": 5})
    kept = identify(instance, NetworkSettings(), replace(bare, observed={"r1": (used,)}))
    assert (kept.subnet, kept.vni) == (identity.subnet, 5)


def lab(unreachable: Sequence[str] = (), **placements: object) -> Snapshot:
    robots = [robot(name, underlay_address=f"192.168.0.{name[1]}") for name in ROBOTS if name not in unreachable]
    return found(*robots, unreachable=dict.fromkeys(unreachable, "down"), placements=placements)


placed = st.dictionaries(NAME, st.sampled_from(ROBOTS), max_size=8)
modes = st.sampled_from(["overlay", "overlay", "host", "both", "none"])


@st.composite
def experiments(draw: st.DrawFn) -> tuple[Experiment, dict[str, str]]:
    where = draw(placed)
    return experiment(*(service(name, network=draw(modes)) for name in where)), where


@settings(deadline=None)
@given(experiments())
def test_every_member_reaches_every_other(world: tuple[Experiment, dict[str, str]]) -> None:
    what, where = world
    overlay = layout(what, where, lab())
    check(overlay, what, where)
    for one in overlay.vteps:
        assert set(overlay.flood[one]) == {vtep for other, vtep in overlay.vteps.items() if other != one}
        services = {(mac, overlay.vteps[where[name]]) for name, mac in overlay.macs.items() if where[name] != one}
        bridges = {(overlay.bridge_macs[other], vtep) for other, vtep in overlay.vteps.items() if other != one}
        assert set(overlay.fdb[one]) == services | bridges


@settings(deadline=None)
@given(experiments(), st.lists(st.sampled_from(ROBOTS), unique=True))
def test_a_second_run_finds_the_same_even_with_robots_out_of_reach(
    world: tuple[Experiment, dict[str, str]], lost: list[str]
) -> None:
    what, where = world
    first = layout(what, where, lab())
    remembered = record(first, what, where, "here")
    assert json.loads(json.dumps(remembered)) == remembered
    second = layout(what, dict(reversed(where.items())), lab(lost, hello=remembered))
    assert second == first
    assert record(second, what, where, "here", remembered) == remembered
    assert HostsFile(second).text == HostsFile(first).text


json_values = st.recursive(
    st.one_of(
        st.none(), st.booleans(), st.integers(), st.text(max_size=8), addresses, near, st.just("02:00:00:00:00:01")
    ),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(st.text(max_size=3), inner, max_size=3)),
    max_leaves=6,
)
entries = st.fixed_dictionaries({}, optional={key: json_values for key in ("robot", "ip", "mac", "vtep", "gateway")})
hostile = st.fixed_dictionaries(
    {},
    optional={
        "services": st.one_of(json_values, st.dictionaries(NAME, entries, max_size=4)),
        "robots": st.one_of(json_values, st.dictionaries(st.sampled_from(ROBOTS), entries, max_size=4)),
        **{key: json_values for key in ("vni", "subnet", "mtu", "serial", "source", "port")},
    },
)


@settings(deadline=None, max_examples=examples(300))
@given(experiments(), hostile, st.booleans())
def test_no_record_makes_a_bad_overlay(
    world: tuple[Experiment, dict[str, str]], value: dict[str, object], ours: bool
) -> None:
    what, where = world
    read_record(value)
    try:
        overlay = layout(what, where, lab(**{"hello" if ours else "other": value}))
    except UsageError:
        # A subnet that another says it has may leave none; one of our own may be too small.
        return
    check(overlay, what, where)
    assert overlay.vteps == layout(what, where, lab()).vteps
    assert record(overlay, what, where, "here", value)["serial"] >= 1


def check(overlay: Overlay, what: Experiment, where: dict[str, str]) -> None:
    modes_of = {name: one.network for name, one in what.services.items()}
    on_it = {name for name, mode in modes_of.items() if mode in ("overlay", "both")}
    assert set(overlay.addresses) == on_it
    assert set(overlay.macs) == {name for name, mode in modes_of.items() if mode == "overlay"}
    assert set(overlay.vteps) == set(overlay.gateways) == {where[name] for name in on_it}
    assert set(overlay.names) == {name for name, mode in modes_of.items() if mode != "none"}
    every = [*overlay.addresses.values(), *overlay.gateways.values()]
    assert len(set(every)) == len(every)
    if on_it:
        subnet = IPv4Network(overlay.subnet)
        assert all(ip_address(ip) in subnet for ip in every)
        assert not any(ip_address(vtep) in subnet for vtep in overlay.vteps.values())
        assert 0 < overlay.vni < 1 << 24
        assert overlay.mtu == 1450
