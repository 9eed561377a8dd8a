"""Earlier runs, and what evenness costs: run records -> costs per robot; a Problem -> its Pareto front.

Takes parsed run records, or a Problem; gives values. Pure. The objective itself is in `arrays`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

import msgspec
from msgspec.structs import replace

from srprov.assignment.model import Assignment, Problem
from srprov.codes import Code
from srprov.errors import UsageError

RECOMMENDED = 0.3
"""The `fairness` that docs/assignment.md recommends; benchmarks/assignment shows why."""
STEPS = (0.0, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 0.9, 1.0)


class Point(msgspec.Struct, frozen=True, kw_only=True):
    """One setting of fairness and what it leads to."""

    fairness: float
    cost: float
    jain: float
    placed: Mapping[str, str]


def read_record(record: Any, where: str) -> dict[str, float]:  # noqa: ANN401 - JSON is any
    """Return robot -> cost allocated to it, from `{"assignment": {service: robot}, "costs": {service: cost}}`.

    Raises:
        UsageError: It is not of that shape; `where` names it.
    """
    hint = 'it must hold {"assignment": {service: robot}, "costs": {service: cost}}'
    placed = record.get("assignment") if isinstance(record, Mapping) else None
    costs = record.get("costs") if isinstance(record, Mapping) else None
    if not isinstance(placed, Mapping) or not isinstance(costs, Mapping):
        raise UsageError(f"{where} is not a run record", hint=hint, code=Code.RECORD)
    sums: dict[str, float] = {}
    for service, cost in costs.items():
        number = isinstance(cost, (int, float)) and not isinstance(cost, bool) and 0 <= cost < 1e9
        if not number or not isinstance(placed.get(service), str):
            raise UsageError(f"{where}: no robot or no cost for '{service}'", hint=hint, code=Code.RECORD)
        sums[placed[service]] = sums.get(placed[service], 0.0) + float(cost)
    return sums


def pareto(
    problem: Problem, solve: Callable[[Problem], Assignment], steps: Sequence[float] = STEPS
) -> tuple[Point, ...]:
    """Return settings of fairness that nothing else beats in both cost and evenness, in the order of cost.

    Args:
        problem: What must be placed.
        solve: The solver.
        steps: The settings that are tried.

    Raises:
        NoAssignment: as the solver does.
    """
    points = []
    for step in sorted(steps):
        answer = solve(replace(problem, fairness=replace(problem.fairness, weight=step)))
        points.append(Point(fairness=step, cost=answer.cost, jain=answer.jain, placed=answer.placed))
    return tuple(_front(points))


def _front(points: Iterable[Point]) -> Iterator[Point]:
    best = -math.inf
    for point in sorted(points, key=lambda point: (point.cost, -point.jain, point.fairness)):
        if point.jain > best + 1e-12:
            best = point.jain
            yield point
