"""Who runs what: the exact answer, and what is said about it.

Takes a Problem, gives an Assignment or raises NoAssignment. Pure and deterministic: everything is laid out in name
order. Which objective is minimised is in `arrays`; without pools and relations it is the paper's min-cost flow
(`solve_flow`), otherwise `solve_pools`. With `sticky` a service stays unless no placement at all lets it, and then as
few as possible move. What is equal in cost and moves is decided by the solver, which sees the same input each time.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from srprov.assignment import explain, report
from srprov.assignment.arrays import SCALE, Arrays, arrays
from srprov.assignment.cost import CostTerms, jain
from srprov.assignment.model import Assignment, Choice, Move, Problem
from srprov.assignment.solve_flow import flow
from srprov.assignment.solve_pools import solve_table
from srprov.assignment.table import Array, Outcome, Table


def solve(problem: Problem, seconds: float | None = None) -> Assignment:
    """Give the best assignment: see the module for what best means.

    Args:
        problem: What must be placed.
        seconds: Stop searching after so long, with the best found and how far it may be off; None: never.

    Raises:
        NoAssignment: Some services can't all be placed; says which, and what would help.
    """
    if any(robot in problem.misses[name] for name, robot in problem.fixed.items()):
        raise explain.no_assignment(problem)
    laid = arrays(problem)
    best = _best(problem, laid, seconds)
    if best is None:
        raise explain.no_assignment(problem)
    return _assignment(problem, laid, best, _least(problem, laid, best, seconds))


@dataclass(frozen=True, slots=True)
class _Best:
    """A choice, and by how much another could be better in what was minimised."""

    outcome: Outcome
    gap: int
    """Millionths."""


def run(table: Table, seconds: float | None = None) -> Outcome | None:
    """Give the cheapest choice of a table by the method that fits it, or None when there is none."""
    return flow(table) if table.plain else solve_table(table, seconds)


def _best(problem: Problem, laid: Arrays, seconds: float | None) -> _Best | None:
    if not problem.sticky or not laid.moves.any():
        return _free(laid, laid.wanted, seconds)
    # where everything can stay that could stay alone, fewer moves are not possible, and only the cost is left to decide
    stay = run(laid.table(laid.wanted, laid.fewest()), seconds)
    if stay is not None:
        return _Best(stay, stay.cost - stay.bound)
    factor = 1 + laid.nodes * int(laid.wanted[laid.allowed].max(initial=0))
    found = run(laid.table(laid.sticky(laid.wanted)), seconds)
    return None if found is None else _Best(found, (found.cost - found.bound) % factor)


def _free(laid: Arrays, wanted: Array, seconds: float | None) -> _Best | None:
    factor = 1 + int(laid.moves.max(axis=1, initial=0).sum())
    found = run(laid.table(laid.free(wanted)), seconds)
    return None if found is None else _Best(found, found.cost // factor - found.bound // factor)


def _least(problem: Problem, laid: Arrays, best: _Best, seconds: float | None) -> _Best:
    """Give the choice of least cost, which stickiness and fairness may keep from being the best."""
    if (laid.wanted == laid.cost).all() and not (problem.sticky and laid.moves.any()):
        return best
    cheapest = _free(laid, laid.cost, seconds)
    assert cheapest is not None, "stickiness and fairness change costs, not what is possible"
    return cheapest


def _assignment(problem: Problem, laid: Arrays, best: _Best, least: _Best) -> Assignment:
    chosen = _choices(laid, best.outcome)
    shares = _discounts(laid, best.outcome)
    where: dict[str, tuple[str, int]] = {name: (robot, 0) for name, robot in problem.fixed.items()}
    where |= {name: (robot, slot) for names, robot, slot in chosen for name in names}
    terms = {name: problem.cost(name, *where[name], shares.get(name, 1.0)) for name in sorted(where)}
    placed = dict(sorted({**problem.frozen, **{name: robot for name, (robot, _) in where.items()}}.items()))
    cost = sum(term.total for term in terms.values())
    spared = _units(laid, best.outcome) - _units(laid, least.outcome)
    together = {pool.name for item in best.outcome.items for pool in laid.items[item].pools}
    return Assignment(
        placed=placed,
        cost=cost,
        terms=terms,
        optimal=spared <= 0 and least.gap == 0 and best.gap == 0,
        least=cost - spared / SCALE if spared > 0 else cost,
        gap=max(best.gap, least.gap) / SCALE,
        moves=_moves(problem, placed),
        frozen=tuple(sorted(problem.frozen)),
        pools={pool.name: "together" if pool.name in together else "apart" for pool in problem.pools},
        matrix=report.matrix(problem),
        why_not=report.why_not(problem),
        runner_up=report.runners_up(problem, chosen, shares),
        jain=_jain(problem, placed, terms),
        notes=_notes(problem),
    )


def _choices(laid: Arrays, found: Outcome) -> list[Choice]:
    """Give what runs where, in the order of items."""
    return [(laid.names[item], *laid.places[place]) for item, place in zip(found.items, found.places, strict=True)]


def _discounts(laid: Arrays, found: Outcome) -> dict[str, float]:
    """Give the discount of every service whose pool runs together."""
    pools = [pool for item in found.items for pool in laid.items[item].pools]
    return {name: pool.discount for pool in pools for name in pool.services}


def _units(laid: Arrays, found: Outcome) -> int:
    return sum(int(laid.cost[pair]) for pair in zip(found.items, found.places, strict=True))


def _jain(problem: Problem, placed: Mapping[str, str], terms: Mapping[str, CostTerms]) -> float:
    """Give Jain's index over what every reachable robot carries: now, and in the runs of the history."""
    sums = {robot: problem.fairness.carried.get(robot, 0.0) for robot in problem.loads}
    for name, term in terms.items():
        sums[placed[name]] += term.total
    return jain(sums.values())


def _moves(problem: Problem, placed: Mapping[str, str]) -> tuple[Move, ...]:
    before = problem.previous
    return tuple(Move(service=s, source=before[s], target=placed[s]) for s in sorted(before) if before[s] != placed[s])


def _notes(problem: Problem) -> tuple[str, ...]:
    """Give each assumption once, with the robots it was made for."""
    robots: dict[str, list[str]] = {}
    for robot, loads in problem.loads.items():
        for note in loads[0].notes:
            robots.setdefault(note, []).append(robot)
    return tuple(f"{', '.join(names)}: {note}" for note, names in sorted(robots.items()))
