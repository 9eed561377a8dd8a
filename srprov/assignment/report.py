"""What an assignment tells beside the answer: the cost matrix, why not elsewhere, the next best robot.

Takes a Problem and what was chosen; gives mappings that work out a service's part when it is asked for. Pure.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from srprov.assignment.model import Choice, LazyMapping, Problem, RunnerUp


def matrix(problem: Problem) -> Mapping[str, Mapping[str, float | None]]:
    """Return service -> robot -> cost in the robot's first slot, None where it cannot run."""
    return LazyMapping(tuple(problem.misses), lambda service: _row(problem, service))


def why_not(problem: Problem) -> Mapping[str, Mapping[str, str]]:
    """Return service -> robot -> reason, for every robot that cannot run the service."""
    return LazyMapping(tuple(problem.misses), lambda service: reasons(problem, service))


def reasons(problem: Problem, service: str) -> dict[str, str]:
    """Return robot -> reason for every robot that cannot run a service."""
    return {robot: "; ".join(miss.text for miss in lacks) for robot, lacks in problem.misses[service].items()}


def runners_up(problem: Problem, chosen: Sequence[Choice], discounts: Mapping[str, float]) -> Mapping[str, RunnerUp]:
    """Return the best other robot of each service, in its first free slot, or its very first when it is full."""
    used: dict[str, int] = {}
    for _, robot, _ in chosen:
        used[robot] = used.get(robot, 0) + 1
    mine: dict[str, Choice] = {}
    for choice in chosen:
        if problem.able(choice[0]).bit_count() > 1:
            mine.update(dict.fromkeys(choice[0], choice))
    return LazyMapping(tuple(sorted(mine)), lambda service: _runner_up(problem, mine[service], used, discounts))


def _row(problem: Problem, service: str) -> dict[str, float | None]:
    lacking = problem.misses[service]
    return {
        robot: None if robot in lacking or robot not in problem.loads else problem.cost(service, robot).total
        for robot in problem.robots
    }


def _runner_up(problem: Problem, choice: Choice, used: Mapping[str, int], discounts: Mapping[str, float]) -> RunnerUp:
    services, robot, slot = choice

    def price(where: str, which: int) -> float:
        return sum(problem.cost(name, where, which, discounts.get(name, 1.0)).total for name in services)

    now, others = price(robot, slot), []
    for other in problem.eligible(services):
        full = used.get(other, 0) >= problem.slots[other]
        cost = price(other, 0 if full else used.get(other, 0))
        if other != robot:
            others.append(RunnerUp(robot=other, cost=cost, difference=cost - now, full=full))
    return min(others, key=lambda runner: (runner.cost, runner.robot))
