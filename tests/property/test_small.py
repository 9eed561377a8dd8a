"""Small, plain problems in plain Python: the same as the flow over arrays, and what is left open decided by names."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import permutations
from random import Random
from typing import Any

import pytest
from msgspec.structs import replace

from srprov.assignment import problem, solve_arrays, solve_small
from srprov.assignment.cost import terms
from srprov.assignment.model import Choice, Problem
from srprov.assignment.solve import solve
from srprov.definitions.model import Placement, Weights
from srprov.errors import NoAssignment
from tests.conftest import examples
from tests.unit.assignment.worlds import GIB, experiment, found, robot, service

BLOCKS = range(20)
PER_BLOCK = 200  # four thousand problems in the long profile


def task(seed: int, most: int = 8, random: Random | None = None) -> Problem:
    """Return a random plain problem of up to `most` services and robots with many ties; `random` mixes the input."""
    dice = Random(seed)
    names = [f"s{i}" for i in range(dice.randint(1, most))]
    robots = [f"r{i}" for i in range(dice.randint(1, most))]
    away = {name: "no route" for name in robots if dice.random() < 0.08}
    same_cost, alike = dice.random() < 0.3, dice.random() < 0.3
    services = [
        service(
            name,
            cost=10.0 if same_cost else dice.choice((0.0, 10.0, 50.0, round(dice.uniform(0, 100), 2))),
            tags=tuple(tag for tag in ("arm", "eye") if dice.random() < 0.2),
            robot=dice.choice(robots) if dice.random() < 0.05 else "",
        )
        for name in names
    ]
    facts = [
        robot(
            name,
            load1=0.0 if alike else dice.choice((0.0, 1.0, 1.5, 3.0, 5.0)),
            memory_available=8 * GIB if alike else dice.randint(0, 8) * GIB,
            speed_mbit=54.0 if alike else dice.choice((0.0, 6.0, 54.0, 1000.0)),
            tags=tuple(tag for tag in ("arm", "eye") if dice.random() < 0.8),
        )
        for name in robots
        if name not in away
    ]
    groups = [
        tuple(dice.sample(names, dice.randint(2, min(4, len(names)))))
        for _ in range(2)
        if names[1:] and dice.random() < 0.2
    ]
    what = experiment(
        *services,
        same_robot=tuple(groups),
        weights=dice.choice((Weights(), Weights(cpu=0.7, memory=0.1, swap=0.1, bandwidth=0.1))),
        placement=Placement(sticky=dice.random() < 0.5),
    )
    where = found(*facts, unreachable=away)
    slots = {name: dice.choice((0, 1, 1, 2, 2, 3)) for name in robots}
    running = dice.choice((0.0, 0.5, 1.0))
    previous = {name: dice.choice((*robots, "gone")) for name in names if dice.random() < running}
    if random is not None:
        what = replace(what, services=mixed(what.services, random), same_robot=tuple(reversed(what.same_robot)))
        where = replace(where, facts=mixed(where.facts, random), unreachable=mixed(away, random))
        slots, previous = mixed(slots, random), mixed(previous, random)
    again = dice.random() < 0.2
    return problem.build(what, {}, where, previous, slots=slots, reassign_unreachable=again)


def mixed(mapping: Mapping[str, Any], random: Random) -> dict[str, Any]:
    items = list(mapping.items())
    random.shuffle(items)
    return dict(items)


def worth(one: Problem, chosen: tuple[Choice, ...]) -> tuple[int, int]:
    """Return (cost in millionths, moves), each pair by itself."""
    cost = moves = 0
    for node, where, slot in chosen:
        alpha = sum(one.services[name].cost for name in node)
        cost += round(alpha * terms(1.0, one.loads[where][slot], one.weights).total * 1_000_000)
        moves += one.moved(node, where)
    return cost, moves


@pytest.mark.parametrize("block", BLOCKS)
def test_it_is_as_good_as_the_flow(block: int) -> None:
    """Problems up to 8x8: feasible alike, equal in cost, in moves and in what the cheapest would save."""
    for seed in range(block * PER_BLOCK, block * PER_BLOCK + examples(PER_BLOCK)):
        one = task(seed)
        assert solve_small.small(one)
        mine, flow = solve_small.decide(one), solve_arrays.decide(one)
        assert (mine is None) is (flow is None), seed
        if mine is None or flow is None:
            continue
        assert worth(one, mine.chosen) == worth(one, flow.chosen), seed
        assert (mine.spared, mine.gap, mine.pools) == (flow.spared, flow.gap, flow.pools), seed
        assert [names for names, _, _ in mine.chosen] == [names for names, _, _ in flow.chosen] == list(one.nodes)


def test_what_is_said_of_it_is_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """Cost, moves, least and optimal of the whole answer; or the same refusal, word for word."""
    for seed in range(examples(600)):
        one = task(seed)
        words, numbers = said(one)
        with monkeypatch.context() as patch:
            patch.setattr(solve_small, "small", lambda _problem: False)
            others, theirs = said(one)
        assert words == others, seed
        # costs of equal placements differ below the millionth that they are compared to
        assert numbers == pytest.approx(theirs, abs=1e-5), seed


def said(one: Problem) -> tuple[object, list[float]]:
    """Return what must be the same of an answer, or of a refusal; costs apart."""
    try:
        answer = solve(one)
    except NoAssignment as error:
        return (error.message, error.hint, repr(error.misses)), []
    return (len(answer.moves), answer.optimal, answer.gap, answer.frozen), [answer.cost, answer.least]


def test_of_equal_placements_it_takes_the_first_in_name_order() -> None:
    """Against trying all: the first service has the first place that any best placement gives it, and so on."""
    ties = 0
    for seed in range(examples(700)):
        one = task(seed, most=4)
        every = sorted(every_choice(one), key=lambda chosen: (order(one, chosen), [c[1:] for c in chosen]))
        mine = solve_small.decide(one)
        assert (mine is None) is (not every), seed
        if mine is not None:
            assert mine.chosen == every[0], seed
            ties += len(every) > 1 and order(one, every[0]) == order(one, every[1])
    assert ties > examples(700) // 7


def every_choice(one: Problem) -> list[tuple[Choice, ...]]:
    """Return every placement, by trying all."""
    places = [(where, slot) for where in one.slots for slot in range(one.slots[where])]
    able = [one.eligible(node) for node in one.nodes]
    return [
        tuple((node, *place) for node, place in zip(one.nodes, some, strict=True))
        for some in permutations(places, len(one.nodes))
        if all(where in robots for (where, _), robots in zip(some, able, strict=True))
    ]


def order(one: Problem, chosen: tuple[Choice, ...]) -> tuple[int, int]:
    cost, moves = worth(one, chosen)
    return (moves, cost) if one.sticky else (cost, moves)


def test_the_order_of_inputs_changes_nothing() -> None:
    """Services, robots, slots, groups and what runs, in any order."""
    for seed in range(examples(500)):
        assert solve_small.decide(task(seed, random=Random(seed))) == solve_small.decide(task(seed)), seed


@pytest.mark.parametrize("seed", range(6))
def test_at_its_largest_it_still_is_as_good(seed: int) -> None:
    """Where long chains of services give way to each other: costs are products, as the paper's are."""
    dice = Random(seed)
    what = experiment(*(service(f"s{i:02}", cost=float(i + 1)) for i in range(36)))
    facts = [robot(f"r{i:02}", load1=4 * dice.random(), memory_available=dice.randint(0, 8) * GIB) for i in range(38)]
    before = {f"s{i:02}": f"r{i // 2:02}" for i in range(36)} if seed % 2 else {}
    one = problem.build(what, {}, found(*facts), before)
    assert solve_small.small(one)
    mine, flow = solve_small.decide(one), solve_arrays.decide(one)
    assert mine is not None and flow is not None
    assert worth(one, mine.chosen) == worth(one, flow.chosen)
    assert mine.spared == flow.spared
