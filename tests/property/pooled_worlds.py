"""Small worlds with pools, relations, slots and history, and every possible answer to them by trying all.

The brute force knows nothing of items, places or arrays: it partitions the services into those that share a slot, and
puts each part into each slot.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from random import Random

import msgspec
from msgspec.structs import replace

from srprov.assignment import problem, solve
from srprov.assignment.cost import at_slot, load, terms
from srprov.assignment.model import Assignment, Problem
from srprov.definitions.containermodel import Port, Runtime
from srprov.definitions.model import Experiment, Placement, Pool, Service, Weights
from srprov.facts.model import Snapshot, TakenPort
from tests.unit.assignment.worlds import GIB, experiment, found, robot, service

Placed = dict[str, tuple[str, int]]


class World(msgspec.Struct, frozen=True, kw_only=True):
    """An experiment, robots, their slots, where services run now, and earlier runs."""

    what: Experiment
    where: Snapshot
    slots: Mapping[str, int]
    previous: Mapping[str, str] = msgspec.field(default_factory=dict)
    history: tuple[Mapping[str, float], ...] = ()
    taken: Mapping[str, tuple[TakenPort, ...]] = msgspec.field(default_factory=dict)

    def problem(self, **options: bool) -> Problem:
        return problem.build(
            self.what,
            {},
            self.where,
            self.previous,
            slots=self.slots,
            history=self.history,
            taken=self.taken,
            **options,
        )

    def solve(self, **options: bool) -> Assignment:
        return solve.solve(self.problem(**options))


def world(seed: int, most: int = 6) -> World:
    """Return a random world of at most `most` services and robots; costs from few values, so that ties are frequent."""
    random = Random(seed)
    names = [chr(ord("a") + i) for i in range(random.randint(1, most))]
    robots = [f"r{i}" for i in range(random.randint(1, most))]
    slots = {name: random.choice((1, 1, 1, 2, 2, 3)) for name in robots}
    while sum(slots.values()) > most + 1:
        slots[max(slots, key=lambda name: (slots[name], name))] -= 1
        if max(slots.values()) == 1:
            break
    services = [
        service(
            name,
            cost=random.choice((0.0, 10.0, 50.0, round(random.uniform(0, 100), 2))),
            tags=tuple(tag for tag in ("arm", "eye") if random.random() < 0.25),
            robot=random.choice(robots) if random.random() < 0.05 else "",
        )
        for name in names
    ]
    facts = [
        robot(
            name,
            load1=random.choice((0.0, 1.0, 1.5, 3.0, 5.0)),
            memory_available=random.randint(0, 8) * GIB,
            speed_mbit=random.choice((0.0, 6.0, 54.0, 1000.0)),
            tags=tuple(tag for tag in ("arm", "eye") if random.random() < 0.7),
        )
        for name in robots
    ]
    same = _groups(random, names, 0.35, 1)
    anti_affinity = [
        group for group in _groups(random, names, 0.4, 2) if not any(len(set(group) & set(s)) > 1 for s in same)
    ]
    pools = tuple(
        Pool(name=f"p{i}", services=group, discount=random.choice((0.5, 0.8, 0.9, 1.0)))
        for i, group in enumerate(_groups(random, names, 0.7, 3))
    )
    what = experiment(
        *services,
        same_robot=tuple(same),
        different_robot=tuple(anti_affinity),
        pools=pools,
        weights=random.choice((Weights(), Weights(cpu=0.7, memory=0.1, swap=0.1, bandwidth=0.1))),
        placement=Placement(sticky=random.random() < 0.5),
    )
    previous = {name: random.choice(robots) for name in names if random.random() < 0.3}
    made = World(what=what, where=found(*facts), slots=slots, previous=previous if random.random() < 0.5 else {})
    return with_ports(made, Random(f"ports of {seed}"))


PORTS: tuple[Port, ...] = (("", 80, 80, "tcp"), ("127.0.0.1", 80, 8080, "tcp"), ("10.0.0.1", 80, 80, "tcp"),
                           ("0.0.0.0", 80, 1, "tcp"), ("", 80, 80, "udp"), ("", 81, 81, "tcp"))  # fmt: skip


def with_ports(world: World, random: Random) -> World:
    """Give services ports of their robots, and robots ports that somebody else has; half of the worlds have none."""
    if random.random() < 0.5:
        return world
    services = dict(world.what.services)
    for name, one in services.items():
        if random.random() < 0.4:
            published = Runtime(ports=(random.choice(PORTS),))
            listening = Runtime(expose=((80, "tcp"),))
            host = random.random() < 0.2
            changed = replace(one, runtime=listening if host else published, network="host" if host else "overlay")
            mates = [group for group in world.what.same_robot if name in group]
            if not any(clash(changed, services[mate]) for group in mates for mate in group if mate != name):
                services[name] = changed
    taken = {
        robot: (TakenPort(address=address, port=port, protocol=protocol, by="somebody"),)
        for robot in world.slots
        if random.random() < 0.15
        for address, port, _, protocol in [random.choice(PORTS)]
    }
    grouped = [mate for group in world.what.same_robot for mate in group]
    if any(clash(services[a], services[b]) for a in grouped for b in grouped if a < b):
        return replace(world, taken=taken)
    return replace(world, what=replace(world.what, services=services), taken=taken)


def has(one: Service) -> list[tuple[str, int, str]]:
    """Return (address, port, protocol) of what a service has of its robot."""
    own = [(address, port, kind) for address, port, _, kind in one.runtime.ports]
    return own + [("", port, kind) for port, kind in one.runtime.expose if one.network == "host"]


def clash(one: Service, other: Service) -> bool:
    """Return whether two services cannot be on one robot for their ports."""
    return any(meet(mine, theirs) for mine in has(one) for theirs in has(other))


def meet(mine: tuple[str, int, str], theirs: tuple[str, int, str]) -> bool:
    """Return whether two ports are the same one."""
    everywhere = {mine[0], theirs[0]} & {"", "0.0.0.0"}
    return mine[1:] == theirs[1:] and bool(everywhere or mine[0] == theirs[0])


def _groups(random: Random, names: Sequence[str], chance: float, most: int) -> list[tuple[str, ...]]:
    return [
        tuple(sorted(random.sample(names, random.randint(2, min(4, len(names))))))
        for _ in range(most)
        if len(names) > 1 and random.random() < chance
    ]


def every_answer(world: World) -> Iterator[tuple[Mapping[str, str], int, int]]:
    """Return (service -> robot, moves, cost in millionths) of every possible assignment."""
    nodes = nodes_of(world)
    places = [(name, slot) for name, slots in world.slots.items() for slot in range(slots)]
    for partition in partitions(nodes):
        alphas = [alpha(world, part) for part in partition]
        if any(value is None for value in alphas) or len(partition) > len(places):
            continue
        yield from _put(world, partition, [value or 0.0 for value in alphas], places)


def _put(
    world: World, parts: Sequence[tuple[str, ...]], alphas: Sequence[float], places: Sequence[tuple[str, int]]
) -> Iterator[tuple[Mapping[str, str], int, int]]:
    able = [[place for place in places if all(can_run(world, name, place[0]) for name in part)] for part in parts]

    def go(index: int, used: frozenset[tuple[str, int]]) -> Iterator[list[tuple[str, int]]]:
        if index == len(parts):
            yield []
            return
        for place in able[index]:
            if place not in used:
                yield from ([place, *rest] for rest in go(index + 1, used | {place}))

    for chosen in go(0, frozenset()):
        placed = {name: place[0] for part, place in zip(parts, chosen, strict=True) for name in part}
        if keeps_apart(world, placed):
            moves = sum(world.previous.get(name, where) != where for name, where in placed.items())
            cost = sum(units(world, value, *place) for value, place in zip(alphas, chosen, strict=True))
            yield placed, moves, cost


def nodes_of(world: World) -> list[tuple[str, ...]]:
    """Return what same_robot makes of the services."""
    groups: list[set[str]] = [{name} for name in world.what.services]
    for related in world.what.same_robot:
        joined = set().union(*(group for group in groups if group & set(related)))
        groups = [group for group in groups if not group & joined] + [joined]
    return sorted(tuple(sorted(group)) for group in groups)


def partitions(nodes: Sequence[tuple[str, ...]]) -> Iterator[list[tuple[str, ...]]]:
    """Return every way to put nodes together."""
    if not nodes:
        yield []
        return
    for rest in partitions(nodes[1:]):
        yield [nodes[0], *rest]
        for index, part in enumerate(rest):
            yield [*rest[:index], tuple(sorted((*nodes[0], *part))), *rest[index + 1 :]]


def alpha(world: World, part: Sequence[str]) -> float | None:
    """Return the least alpha of services in one slot, None when no pool lets them share it."""
    nodes = [node for node in nodes_of(world) if set(node) <= set(part)]
    pools = [pool for pool in world.what.pools if set(pool.services) <= set(part)]
    best: float | None = None
    for used in product((False, True), repeat=len(pools)):
        chosen = [pool for pool, flag in zip(pools, used, strict=True) if flag]
        names = [name for pool in chosen for name in pool.services]
        if len(names) != len(set(names)) or not _connected(nodes, [set(pool.services) for pool in chosen]):
            continue
        total = sum(world.what.services[name].cost for name in part)
        total -= sum((1 - pool.discount) * sum(world.what.services[n].cost for n in pool.services) for pool in chosen)
        best = total if best is None else min(best, total)
    return best


def _connected(nodes: Sequence[tuple[str, ...]], links: Sequence[set[str]]) -> bool:
    parts = [set(node) for node in nodes]
    for link in links:
        joined = set().union(*(part for part in parts if part & link))
        parts = [part for part in parts if not part & joined] + [joined]
    return len(parts) == 1


def can_run(world: World, name: str, where: str) -> bool:
    """Return whether a robot has the tags and the ports, and is the pinned one if any."""
    wants, robot = world.what.services[name], world.where.facts[where]
    theirs = [(one.address, one.port, one.protocol) for one in world.taken.get(where, ())]
    free = not any(meet(mine, other) for mine in has(wants) for other in theirs)
    return set(wants.requires.tags) <= set(robot.tags) and wants.robot in ("", where) and free


def keeps_apart(world: World, placed: Mapping[str, str]) -> bool:
    """Return whether different_robot holds, and nobody has a port of another on its robot."""
    for group in world.what.different_robot:
        where = [placed[name] for name in group if name in placed]
        if len(set(where)) < len(where):
            return False
    services = world.what.services
    return not any(placed[a] == placed[b] and clash(services[a], services[b]) for a in placed for b in placed if a < b)


def units(world: World, value: float, where: str, slot: int) -> int:
    """Return a cost in millionths."""
    what = world.what
    beta = at_slot(load(world.where.facts[where], what.placement.bandwidth_reference_mbit), slot, world.slots[where])
    return round(1_000_000 * value * terms(1.0, beta, what.weights).total)


def without(world: World, names: set[str]) -> World:
    """Return a world without some services; pools and groups lose them too."""
    what = world.what

    def rest(group: Sequence[str]) -> tuple[str, ...]:
        return tuple(name for name in group if name not in names)

    pools = tuple(replace(pool, services=rest(pool.services)) for pool in what.pools)
    return replace(
        world,
        what=replace(
            what,
            services={name: one for name, one in what.services.items() if name not in names},
            same_robot=tuple(rest(group) for group in what.same_robot if len(rest(group)) > 1),
            different_robot=tuple(rest(group) for group in what.different_robot if len(rest(group)) > 1),
            pools=tuple(pool for pool in pools if len(pool.services) > 1),
        ),
        previous={name: where for name, where in world.previous.items() if name not in names},
    )
