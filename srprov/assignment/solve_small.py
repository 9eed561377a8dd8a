"""A small, plain problem solved in plain Python: nodes and places, nothing else.

Takes a Problem, gives a Decision, or None when not every node finds a place. Pure. For a dozen robots this takes less
time than to import numpy and OR-Tools. It minimises what `arrays` does, to the same millionth, and where that leaves a
choice it takes the first in name order: the first service gets the first robot that any best placement gives it, then
the second service, and so on. Source: docs/assignment.md.

All of it is one integer per pair: with M the most services that could move, C the largest cost, N nodes and P places

    sticky      (moves * (1 + N * C) + cost) * P^N + place * P^(N - 1 - node)
    otherwise   (cost * (1 + M) + moves)     * P^N + place * P^(N - 1 - node)

so there is exactly one best choice, and no order of the work can change it.

Source: shortest augmenting paths; R. Jonker and A. Volgenant, *A shortest augmenting path algorithm for dense and
sparse linear assignment problems*, Computing 38, 1987.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import msgspec

from srprov.assignment.cost import terms
from srprov.assignment.model import SCALE, Decision, Problem

MOST = 50_000
"""Nodes * nodes * places: up to here it takes a few hundredths of a second at most."""

_Pair = tuple[int, int]
"""Cost in millionths, and services that run on another robot now."""


def small(problem: Problem) -> bool:
    """Return whether a problem is this solver's: no pool to decide, nobody to keep apart, no fairness, not large."""
    node_of = {name: index for index, node in enumerate(problem.nodes) for name in node}
    if any(len(pool.services) > 1 and node_of.keys() >= set(pool.services) for pool in problem.pools):
        return False
    if any(len({node_of[name] for name in group if name in node_of}) > 1 for group in problem.kept_apart):
        return False
    if problem.fairness.weight > 0 and any(problem.previous.keys().isdisjoint(node) for node in problem.nodes):
        return False
    return len(problem.nodes) ** 2 * sum(problem.slots.values()) <= MOST


def decide(problem: Problem) -> Decision | None:
    """Return the best placement of a small problem: `sticky` says what comes first, moves or cost."""
    laid = _lay(problem)
    best = _best(laid, sticky=problem.sticky)
    if best is None:
        return None
    spared = 0
    if problem.sticky and any(moves for row in laid.rows for _, moves in row.values()):
        cheapest = _best(laid, sticky=False)
        assert cheapest is not None, "stickiness changes costs, not what is possible"
        spared = laid.cost(best) - laid.cost(cheapest)
    chosen = tuple((node, *laid.places[place]) for node, place in zip(problem.nodes, best, strict=True))
    return Decision(chosen=chosen, spared=spared)


class _Laid(msgspec.Struct, frozen=True):
    """The pairs that are possible: per node, place -> what it costs and moves there."""

    places: tuple[tuple[str, int], ...]
    """(robot, slot), in name order."""
    rows: tuple[Mapping[int, _Pair], ...]
    most: int
    """Services that could move."""

    def cost(self, found: Sequence[int]) -> int:
        return sum(row[place][0] for row, place in zip(self.rows, found, strict=True))


def _lay(problem: Problem) -> _Laid:
    places = tuple((robot, slot) for robot in problem.slots for slot in range(problem.slots[robot]))
    bits = {robot: 1 << bit for bit, robot in enumerate(problem.loads)}
    units = [terms(1.0, problem.loads[robot][slot], problem.weights).total for robot, slot in places]
    rows = []
    for node in problem.nodes:
        # the operations and their order are those of `arrays` and `bundles`: costs are equal to the last bit
        alpha, able = max(0.0, sum(problem.services[name].cost for name in node)), problem.able(node)
        rows.append(
            {
                place: (round(alpha * units[place] * SCALE), problem.moved(node, robot))
                for place, (robot, _) in enumerate(places)
                if able & bits[robot]
            }
        )
    return _Laid(places=places, rows=tuple(rows), most=sum(map(len, problem.nodes)))


def _best(laid: _Laid, *, sticky: bool) -> list[int] | None:
    """Return the place of every node in the one best choice."""
    nodes, places = len(laid.rows), max(1, len(laid.places))
    largest = max((cost for row in laid.rows for cost, _ in row.values()), default=0)
    per_cost, per_move = (1, 1 + nodes * largest) if sticky else (1 + laid.most, 1)
    all_ties = places**nodes
    rows = [
        {
            place: (cost * per_cost + moves * per_move) * all_ties + place * places ** (nodes - 1 - node)
            for place, (cost, moves) in row.items()
        }
        for node, row in enumerate(laid.rows)
    ]
    return cheapest(rows, len(laid.places))


def cheapest(rows: Sequence[Mapping[int, int]], places: int) -> list[int] | None:
    """Return the place of every row at the least sum, each place once at most; None when that cannot be.

    Args:
        rows: Place -> cost, at least 0, where the row can be.
        places: How many there are.
    """
    holder = [-1] * places
    u, v = [0] * len(rows), [0] * places
    for row in range(len(rows)):
        if not _insert(row, rows, holder, u, v):
            return None
    where = {row: place for place, row in enumerate(holder)}
    return [where[row] for row in range(len(rows))]


def _insert(start: int, rows: Sequence[Mapping[int, int]], holder: list[int], u: list[int], v: list[int]) -> bool:
    """Place one more row along the shortest path of rows that give way; keep the prices u + v below every cost."""
    near: dict[int, int] = {}
    came_from: dict[int, int] = {}
    done: dict[int, int] = {}
    at, gone = start, 0
    while True:
        for place, cost in rows[at].items():
            away = gone + cost - u[at] - v[place]
            if place not in done and (place not in near or away < near[place]):
                near[place], came_from[place] = away, at
        if not near:
            return False
        place = min(near, key=near.__getitem__)
        gone = done[place] = near.pop(place)
        if holder[place] < 0:
            break
        at = holder[place]
    for other, away in done.items():
        v[other] -= gone - away
        if holder[other] >= 0:
            u[holder[other]] += gone - away
    u[start] += gone
    held = {holder[other]: other for other in done}
    while True:
        at = came_from[place]
        holder[place] = at
        if at == start:
            return True
        place = held[at]
