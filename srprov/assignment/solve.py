"""Who runs what: the exact answer, and what is said about it.

Takes a Problem, gives an Assignment or raises NoAssignment. Pure and deterministic: everything is laid out in name
order. `solve_small` decides what is small and plain, `solve_arrays` everything else; both minimise the same. With
`sticky` a service stays unless no placement at all lets it, and then as few as possible move.
"""

from __future__ import annotations

from collections.abc import Mapping

from srprov.assignment import report, solve_small
from srprov.assignment.cost import CostTerms, jain
from srprov.assignment.model import SCALE, Assignment, Decision, Move, Problem
from srprov.errors import NoAssignment


def solve(problem: Problem, seconds: float | None = None) -> Assignment:
    """Return the best assignment: see the module for what best means.

    Args:
        problem: What must be placed.
        seconds: Stop searching after so long, with the best found and how far it may be off; None: never.

    Raises:
        NoAssignment: Some services can't all be placed; says which, and what would help.
        UsageError: Too many ways to combine pools with same_robot.
    """
    if any(robot in problem.misses[name] for name, robot in problem.fixed.items()):
        raise _refusal(problem)
    decision = solve_small.decide(problem) if solve_small.small(problem) else _by_arrays(problem, seconds)
    if decision is None:
        raise _refusal(problem)
    return _assignment(problem, decision)


def _by_arrays(problem: Problem, seconds: float | None) -> Decision | None:
    from srprov.assignment import solve_arrays  # heavy: numpy and OR-Tools

    return solve_arrays.decide(problem, seconds)


def _refusal(problem: Problem) -> NoAssignment:
    from srprov.assignment import explain  # heavy: numpy and OR-Tools

    return explain.no_assignment(problem)


def _assignment(problem: Problem, decision: Decision) -> Assignment:
    shares = {name: pool.discount for pool in decision.pools for name in pool.services}
    where: dict[str, tuple[str, int]] = {name: (robot, 0) for name, robot in problem.fixed.items()}
    where |= {name: (robot, slot) for names, robot, slot in decision.chosen for name in names}
    terms = {name: problem.cost(name, *where[name], shares.get(name, 1.0)) for name in sorted(where)}
    placed = dict(sorted({**problem.frozen, **{name: robot for name, (robot, _) in where.items()}}.items()))
    cost = sum(term.total for term in terms.values())
    together = {pool.name for pool in decision.pools}
    return Assignment(
        placed=placed,
        cost=cost,
        terms=terms,
        optimal=decision.spared <= 0 and decision.gap == 0,
        least=cost - decision.spared / SCALE if decision.spared > 0 else cost,
        gap=decision.gap / SCALE,
        moves=_moves(problem, placed),
        frozen=tuple(sorted(problem.frozen)),
        pools={pool.name: "together" if pool.name in together else "apart" for pool in problem.pools},
        matrix=report.matrix(problem),
        why_not=report.why_not(problem),
        runner_up=report.runners_up(problem, decision.chosen, shares),
        jain=_jain(problem, placed, terms),
        notes=_notes(problem),
    )


def _jain(problem: Problem, placed: Mapping[str, str], terms: Mapping[str, CostTerms]) -> float:
    """Return Jain's index over what every reachable robot carries: now, and in the runs of the history."""
    sums = {robot: problem.fairness.carried.get(robot, 0.0) for robot in problem.loads}
    for name, term in terms.items():
        sums[placed[name]] += term.total
    return jain(sums.values())


def _moves(problem: Problem, placed: Mapping[str, str]) -> tuple[Move, ...]:
    before = problem.previous
    return tuple(Move(service=s, source=before[s], target=placed[s]) for s in sorted(before) if before[s] != placed[s])


def _notes(problem: Problem) -> tuple[str, ...]:
    """Return each assumption once, with the robots it was made for."""
    robots: dict[str, list[str]] = {}
    for robot, loads in problem.loads.items():
        for note in loads[0].notes:
            robots.setdefault(note, []).append(robot)
    return tuple(f"{', '.join(names)}: {note}" for note, names in sorted(robots.items()))
