"""Which services cannot all be placed: a set of them that can as soon as any one is left out.

Takes a Problem without a solution; gives the services of a conflict, and tells whether a change would resolve it.
Pure. Leaving a service out also takes it out of its pools and groups.

Source: Hall's theorem for the plain model: a service that finds no place when others are placed as well as possible
spans, by alternating paths, a set whose robots have exactly one slot too few. With pools and relations, and inside
groups: U. Junker, *QuickXplain*, AAAI 2004, over an exact answer to "can these be placed?".
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar

import numpy as np
from msgspec.structs import replace

from srprov.assignment.arrays import arrays
from srprov.assignment.model import Problem, ServiceGroup
from srprov.assignment.solve_flow import assign
from srprov.assignment.solve_pools import solve_table
from srprov.assignment.table import Array, ProblemTable, Selection

_LEAST_S = 0.05
"""With less left, or when that is left at the end, a search was not long enough to prove anything."""
_PAIRS_A_SECOND = 2_000_000
"""Of what is placed and where it can be: what a flow takes."""
_until: ContextVar[float | None] = ContextVar("until", default=None)


class OutOfTimeError(Exception):
    """The time for explaining is over: whether something can be placed is not known."""


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Limit all searches in the block together; beyond that they raise OutOfTimeError."""
    token = _until.set(time.monotonic() + seconds)
    try:
        yield
    finally:
        _until.reset(token)


def check_time() -> None:
    """Return while there is time.

    Raises:
        OutOfTimeError: A `time_limit` around this was reached.
    """
    until = _until.get()
    if until is not None and time.monotonic() > until:
        raise OutOfTimeError


def _solved(table: ProblemTable) -> Selection | None:
    """Return a cover, or None when there is none.

    Raises:
        OutOfTimeError: The time was over before that was known.
    """
    until = _until.get()
    if until is None:
        return solve_table(table)
    # the flow that a search begins with cannot be stopped
    if (left := until - time.monotonic()) > _LEAST_S + table.cost.size / _PAIRS_A_SECOND:
        found = solve_table(table, left)
        if found is not None or until - time.monotonic() > _LEAST_S:
            return found
    raise OutOfTimeError


def smallest_conflict(problem: Problem) -> tuple[ServiceGroup, ...]:
    """Return nodes, cut down to services of which none can be left out; empty when all can be placed.

    Raises:
        OutOfTimeError: A `time_limit` around this was reached.

    Several conflicts may exist. Services with the fewest robots are looked at first. (The smallest of all would be the
    girth of a transversal matroid, which is NP-hard to find.)
    """
    for name, robot in problem.fixed.items():
        if robot in problem.misses[name]:
            return ((name,),)
    if not problem.nodes or feasible(problem):
        return ()
    hall = _hall(problem)
    if hall and all(len(node) == 1 for node in hall):
        return hall  # alternating paths name nobody in vain
    found = _minimal(lambda some: not feasible(cut(problem, some)), _narrowest_first(problem, hall or problem.nodes))
    linked = problem.pools and any(len(node) > 1 for node in problem.nodes)
    return cut(problem, _none_in_vain(problem, found) if linked else found).nodes


def _narrowest_first(problem: Problem, nodes: Iterable[ServiceGroup]) -> list[str]:
    """Return the services of nodes, those with the fewest robots first."""
    return sorted((name for node in nodes for name in node), key=lambda name: (len(problem.eligible((name,))), name))


def cut(problem: Problem, names: Collection[str]) -> Problem:
    """Return a problem with only these services to decide; pools and groups lose the others."""
    kept = set(names)
    nodes = tuple(sorted(rest for node in problem.nodes if (rest := tuple(name for name in node if name in kept))))
    pools = tuple(
        replace(pool, services=tuple(name for name in pool.services if name in kept)) for pool in problem.pools
    )
    return replace(problem, nodes=nodes, pools=tuple(pool for pool in pools if len(pool.services) > 1))


def feasible(problem: Problem) -> bool:
    """Return whether everything that is to be decided can be placed."""
    laid = arrays(problem)
    nodes = laid.nodes
    if (~laid.allowed[:nodes].any(axis=1)).any() and len(laid.items) == nodes:
        return False
    free = np.zeros(laid.cost.shape, dtype=np.int64)
    if not laid.anti_affinity and assign(free[:nodes], laid.allowed[:nodes]) is not None:
        return True
    table = laid.table(free)
    return not table.plain and _solved(table) is not None


def places_needed(problem: Problem) -> int:
    """Return the fewest slots that could do if every robot could run everything: pools together wherever they fit."""
    if not problem.pools:
        return len(problem.nodes)
    laid = arrays(problem)
    somewhere: Array = np.ones((len(laid.items), laid.nodes), dtype=bool)
    table = laid.table(np.ones(somewhere.shape, dtype=np.int64), somewhere)
    found = _solved(replace(table, robots=np.arange(laid.nodes), anti_affinity=()))
    assert found is not None, "there is a place for every node"
    return len(found.items)


def _minimal(broken: Callable[[Sequence[str]], bool], names: list[str]) -> list[str]:
    """Return a part of `names` that is broken while no part of it is; earlier names are preferred."""

    def divide(given: list[str], more: bool, rest: list[str]) -> list[str]:
        if more and broken(given):
            return []
        if len(rest) == 1:
            return rest
        half = len(rest) // 2
        second = divide(given + rest[:half], True, rest[half:])
        return divide(given + second, bool(second), rest[:half]) + second

    return divide([], False, names)


def _none_in_vain(problem: Problem, names: list[str]) -> list[str]:
    """Leave out what is in vain: services that link two pools through a group can hide that from the division."""
    for name in names:
        rest = [other for other in names if other != name]
        if not feasible(cut(problem, rest)):
            return _none_in_vain(problem, rest)
    return names


def _hall(problem: Problem) -> tuple[ServiceGroup, ...]:
    """Return a conflict of nodes in the plain model, the smallest that inserting one after another shows; or none."""
    if problem.pools or problem.kept_apart:
        return ()
    eligible = {node: problem.eligible(node) for node in problem.nodes}
    holds: dict[str, list[ServiceGroup]] = {robot: [] for robot in problem.slots}
    conflicts: list[tuple[ServiceGroup, ...]] = []
    for node in sorted(problem.nodes, key=lambda node: (len(eligible[node]), node)):
        conflict = _insert(node, eligible, holds, problem.slots)
        if conflict:
            conflicts.append(tuple(sorted(conflict)))
    return min(conflicts, key=lambda nodes: (len(nodes), nodes), default=())


def _insert(
    node: ServiceGroup,
    eligible: Mapping[ServiceGroup, Sequence[str]],
    holds: dict[str, list[ServiceGroup]],
    slots: Mapping[str, int],
) -> list[ServiceGroup]:
    """Place one more node, moving others as needed; else give the conflict: what alternating paths reach."""
    came_from: dict[str, ServiceGroup] = {}
    queue = [node]  # every node is held by one robot and every robot visited once, so nothing comes twice
    for at in queue:
        for robot in eligible[at]:
            if robot in came_from:
                continue
            came_from[robot] = at
            if len(holds[robot]) < slots[robot]:
                _shift(robot, node, came_from, holds)
                return []
            queue += holds[robot]
    return queue


def _shift(
    robot: str, start: ServiceGroup, came_from: Mapping[str, ServiceGroup], holds: dict[str, list[ServiceGroup]]
) -> None:
    """Follow an alternating path back from a robot with a free slot, moving each node on it one robot further."""
    while True:
        node = came_from[robot]
        holds[robot].append(node)
        if node == start:
            return
        robot = next(r for r in came_from if node in holds[r] and r != robot)
        holds[robot].remove(node)
