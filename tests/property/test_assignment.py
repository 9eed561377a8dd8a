"""The solver against brute force, and what must hold of every assignment."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from random import Random
from unittest import mock

import msgspec
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from srprov.assignment import conflict as conflicts
from srprov.assignment import explain, few_slots, problem, solve, solve_arrays
from srprov.assignment.arrays import Arrays, arrays
from srprov.assignment.cost import at_slot, load, terms
from srprov.assignment.model import Assignment, Problem
from srprov.definitions.model import Experiment, Placement, Weights
from srprov.errors import NoAssignment
from srprov.facts.model import Snapshot
from tests.conftest import examples
from tests.unit.assignment.worlds import GIB, experiment, found, robot, service

TAGS = ("arm", "eye", "ear")
NAMES = ("a", "b", "c", "d", "e", "f")
ROBOTS = ("r1", "r2", "r3", "r4", "r5", "r6")


class World(msgspec.Struct, frozen=True, kw_only=True):
    what: Experiment
    where: Snapshot
    slots: Mapping[str, int]
    previous: Mapping[str, str] = msgspec.field(default_factory=dict)

    def solve(self, **options: bool) -> Assignment:
        return solve.solve(self.problem(**options))

    def problem(self, **options: bool) -> Problem:
        return problem.build(self.what, {}, self.where, self.previous, slots=self.slots, **options)


tags = st.lists(st.sampled_from(TAGS), unique=True).map(lambda names: tuple(sorted(names)))


@st.composite
def worlds(draw: st.DrawFn) -> World:
    names = NAMES[: draw(st.integers(1, 6))]
    robots = ROBOTS[: draw(st.integers(1, 6))]
    most = 1 if len(robots) > 3 else 2
    # Costs from few values, so that ties are frequent.
    cost = st.one_of(st.sampled_from([0.0, 10.0, 50.0]), st.floats(0, 100))
    services = [
        service(name, cost=draw(cost), tags=draw(st.one_of(st.just(()), tags)), robot=draw(pins(robots)))
        for name in names
    ]
    facts = [
        robot(
            name,
            load1=draw(st.sampled_from([0.0, 1.0, 1.5, 3.0, 5.0])),
            memory_available=draw(st.integers(0, 8)) * GIB,
            speed_mbit=draw(st.sampled_from([0.0, 6.0, 54.0, 1000.0])),
            tags=draw(st.one_of(st.just(TAGS), tags)),
        )
        for name in robots
    ]
    groups = (
        draw(st.lists(st.lists(st.sampled_from(names), min_size=2, max_size=3, unique=True), max_size=1))
        if names[1:]
        else []
    )
    return World(
        what=experiment(
            *services,
            same_robot=tuple(tuple(group) for group in groups),
            weights=draw(st.sampled_from([Weights(), Weights(cpu=0.7, memory=0.1, swap=0.1, bandwidth=0.1)])),
            placement=Placement(sticky=draw(st.booleans())),
        ),
        where=found(*facts),
        slots={name: draw(st.integers(1, most)) for name in robots},
        previous=draw(st.dictionaries(st.sampled_from(names), st.sampled_from(robots), max_size=6)),
    )


def pins(robots: Sequence[str]) -> st.SearchStrategy[str]:
    return st.sampled_from(("",) * 9 + tuple(robots))


def brute_force(world: World) -> Iterator[tuple[int, int]]:
    """Return (moves, cost in millionths) of every possible assignment: all that is tested but the costs is left out."""
    groups: list[set[str]] = [{name} for name in world.what.services]
    for related in world.what.same_robot:
        joined = set().union(*(group for group in groups if group & set(related)))
        groups = [group for group in groups if not group & joined] + [joined]
    places = [(name, slot) for name, slots in world.slots.items() for slot in range(slots)]

    def go(index: int, used: frozenset[tuple[str, int]]) -> Iterator[tuple[int, int]]:
        if index == len(groups):
            yield 0, 0
            return
        for place in places:
            if place not in used and all(can_run(world, name, place[0]) for name in groups[index]):
                moves = sum(world.previous.get(name, place[0]) != place[0] for name in groups[index])
                price = units(world, sorted(groups[index]), *place)
                for rest in go(index + 1, used | {place}):
                    yield rest[0] + moves, rest[1] + price

    return go(0, frozenset())


def can_run(world: World, name: str, where: str) -> bool:
    wants, has = world.what.services[name], world.where.facts[where]
    return set(wants.requires.tags) <= set(has.tags) and wants.robot in ("", where)


def units(world: World, names: Iterable[str], where: str, slot: int) -> int:
    what = world.what
    beta = at_slot(load(world.where.facts[where], what.placement.bandwidth_reference_mbit), slot, world.slots[where])
    return round(1_000_000 * sum(what.services[name].cost for name in names) * terms(1.0, beta, what.weights).total)


@settings(max_examples=examples(400), deadline=None)
@given(worlds(), st.booleans())
def test_no_assignment_is_better_than_the_answer(world: World, reassign: bool) -> None:
    """In moves and cost, in the order that stickiness asks for; and `optimal` and `least` say how it is."""
    every = list(brute_force(world))
    try:
        answer = world.solve(reassign=reassign)
    except NoAssignment:
        assert every == []
        return
    sticky = world.what.placement.sticky and not reassign
    best = min(every, key=lambda value: value if sticky else (value[1], value[0]))
    assert len(answer.moves) == best[0]
    assert abs(answer.cost - best[1] / 1e6) <= 1e-6 * len(answer.placed)
    least = min(price for _, price in every)
    assert answer.optimal is (best[1] == least)
    assert abs(answer.least - least / 1e6) <= 1e-6 * 2 * len(answer.placed)


@settings(max_examples=examples(200), deadline=None)
@given(worlds())
def test_every_answer_is_a_legal_one(world: World) -> None:
    """Every service once, where it can run, groups together; what is told agrees with it."""
    try:
        answer = world.solve()
    except NoAssignment:
        return
    assert sorted(answer.placed) == sorted(world.what.services)
    assert all(can_run(world, name, where) for name, where in answer.placed.items())
    for group in world.what.same_robot:
        assert len({answer.placed[name] for name in group}) == 1
    for name, row in answer.matrix.items():
        assert {where for where, cost in row.items() if cost is None} == set(answer.why_not[name])
        assert row[answer.placed[name]] is not None
        assert name not in answer.runner_up or answer.runner_up[name].robot != answer.placed[name]
    assert abs(sum(terms.total for terms in answer.terms.values()) - answer.cost) < 1e-9
    assert 1 / len(world.where.facts) - 1e-9 <= answer.jain <= 1 + 1e-9
    assert explain.describe(answer)


@settings(max_examples=examples(200), deadline=None)
@given(worlds(), st.randoms(use_true_random=False))
def test_the_order_of_inputs_changes_nothing(world: World, random: Random) -> None:
    """Services, robots, slots and relations in another order give the same answer or the same refusal."""

    def shuffled(mapping: Mapping[str, object]) -> dict[str, object]:
        items = list(mapping.items())
        random.shuffle(items)
        return dict(items)

    groups = [tuple(reversed(group)) for group in reversed(world.what.same_robot)]
    other = World(
        what=replace(world.what, services=shuffled(world.what.services), same_robot=tuple(groups)),  # type: ignore[arg-type]
        where=replace(world.where, facts=shuffled(world.where.facts)),  # type: ignore[arg-type]
        slots=shuffled(world.slots),  # type: ignore[arg-type]
        previous=shuffled(world.previous),  # type: ignore[arg-type]
    )
    assert outcome(other) == outcome(world)


def outcome(world: World) -> tuple[object, ...]:
    """Return an answer with the order of its mappings, or a refusal."""
    try:
        answer = world.solve()
    except NoAssignment as error:
        return error.message, error.hint, repr(error.misses)
    return repr(answer), *explain.describe(answer)


@settings(max_examples=examples(200), deadline=None)
@given(worlds(), st.booleans())
def test_solving_from_its_own_answer_moves_nothing(world: World, reassign: bool) -> None:
    """With and without `--reassign`."""
    try:
        first = world.solve(reassign=reassign)
    except NoAssignment:
        return
    second = replace(world, previous=first.placed).solve(reassign=reassign)
    assert second.placed == first.placed
    assert second.moves == ()


@settings(max_examples=examples(200), deadline=None)
@given(worlds(), st.lists(st.sampled_from([0.0, 2.0, 4.0]), min_size=6, max_size=6))
def test_a_sticky_answer_does_not_follow_the_load(world: World, loads: list[float]) -> None:
    """Whatever the robots' load becomes, what runs stays."""
    world = replace(world, what=replace(world.what, placement=Placement(sticky=True)))
    try:
        first = world.solve()
    except NoAssignment:
        return
    facts = {
        name: replace(one, load1=load) for (name, one), load in zip(world.where.facts.items(), loads, strict=False)
    }
    later = replace(world, previous=first.placed, where=replace(world.where, facts=facts))
    assert later.solve().placed == first.placed


def crowd(seed: int) -> World:
    """Return a world of little else than requirements, dense: conflicts are frequent and need alternating paths."""
    random = Random(seed)
    names, robots = "abcdefgh"[: random.randint(4, 8)], ROBOTS[: random.randint(3, 6)]
    facts = [robot(one, tags=tuple(name for name in names if random.random() < 0.4)) for one in robots]
    what = experiment(*(service(name, tags=(name,)) for name in names))
    return World(what=what, where=found(*facts), slots={name: random.randint(1, 2) for name in robots})


@settings(max_examples=examples(600), deadline=None)
@given(st.one_of(worlds(), st.integers(0, 10**9).map(crowd)))
def test_a_conflict_is_one_and_no_part_of_it_is(world: World) -> None:
    """Against trying everything: infeasible as it is, feasible without any one of its services."""
    task = world.problem()
    conflict = conflicts.smallest_conflict(task)
    eligible = {node: task.eligible(node) for node in task.nodes}
    assert bool(conflict) is not fits(task.nodes, eligible, world.slots)
    if not conflict:
        return
    names = [name for node in conflict for name in node]
    assert not fits(*cut(task, names), world.slots)
    for name in names:
        assert fits(*cut(task, [other for other in names if other != name]), world.slots)
    error = explain.no_assignment(task)
    assert error.hint
    assert sorted(error.misses) == sorted(names)


def cut(task: Problem, names: Sequence[str]) -> tuple[list[tuple[str, ...]], dict[tuple[str, ...], Sequence[str]]]:
    """Return the nodes that are left of some services, and their robots."""
    nodes = [rest for node in task.nodes if (rest := tuple(name for name in node if name in names))]
    return nodes, {node: task.eligible(node) for node in nodes}


def fits(
    nodes: Sequence[tuple[str, ...]], eligible: Mapping[tuple[str, ...], Sequence[str]], slots: Mapping[str, int]
) -> bool:
    """Tell by trying everything whether all nodes find a place."""
    if not nodes:
        return True
    return any(
        slots[where] and fits(nodes[1:], eligible, {**slots, where: slots[where] - 1}) for where in eligible[nodes[0]]
    )


@given(worlds(), st.lists(st.integers(0, 6), min_size=6, max_size=6))
@settings(max_examples=examples(150))
def test_few_slots_at_first_give_the_answer_of_all(world: World, slots: list[int]) -> None:
    """As large problems are solved: from one slot of each robot on, with more where they are used."""
    given_slots = replace(world, slots=dict(zip(world.slots, slots, strict=False))).problem()

    def answer() -> tuple[int, float, int, int]:
        decision = solve_arrays.decide(given_slots)
        if decision is None:
            return -1, 0.0, 0, 0
        each = [(name, robot, slot) for names, robot, slot in decision.chosen for name in names]
        moves = sum(given_slots.moved(names, robot) for names, robot, _ in decision.chosen)
        return moves, sum(given_slots.cost(*one).total for one in each), decision.spared, decision.gap

    moves, cost, *proved = answer()
    one = {robot: min(1, count) for robot, count in given_slots.slots.items()}
    with mock.patch.object(few_slots, "first", lambda _problem: one):
        found_moves, found_cost, *found_proved = answer()
    assert (found_moves, found_proved) == (moves, proved)
    assert abs(found_cost - cost) < 1e-5, "costs are compared to a millionth for each service"


def test_a_large_problem_is_not_laid_out_with_slots_that_cannot_matter() -> None:
    """300 services on 12 robots of 300 slots: where all are pinned to three of them too."""
    names = [f"s{number}" for number in range(300)]
    seen: list[int] = []

    def counted(problem: Problem) -> Arrays:
        seen.append(len(problem.nodes) * sum(problem.slots.values()))
        return arrays(problem)

    for pin, most in ((None, 200_000), ("r", 500_000)):
        services = [service(name, robot=pin and f"r{number % 3}") for number, name in enumerate(names)]
        where = found(*(robot(f"r{number}") for number in range(12)))
        what = experiment(*services, placement=Placement(slots_per_robot=300))
        with mock.patch.object(solve_arrays, "arrays", counted):
            made = solve.solve(problem.build(what, {}, where, {}))
        assert len(made.placed) == 300 and made.optimal
        assert max(seen) < most, seen
