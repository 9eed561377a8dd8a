"""Problems of any size and kind, over whole arrays.

Takes a Problem, gives a Decision, or None when not every node finds a place. Pure and deterministic: everything is laid
out in name order. Which objective is minimised is in `arrays`; without pools and relations it is the paper's min-cost
flow (`solve_flow`), otherwise `solve_pools`. What is equal in cost and moves is decided by the solver, which sees the
same input each time. It imports numpy and OR-Tools, so `solve` imports it only when `solve_small` is not enough.
"""

from __future__ import annotations

import time

import msgspec
from msgspec.structs import replace

from srprov.assignment import few_slots
from srprov.assignment.arrays import Arrays, arrays
from srprov.assignment.model import Decision, Problem
from srprov.assignment.solve_flow import flow, room
from srprov.assignment.solve_pools import solve_table
from srprov.assignment.table import Array, ProblemTable, Selection


def decide(problem: Problem, seconds: float | None = None) -> Decision | None:
    """Return the best placement, or the best found in `seconds` for all searches together; None may mean none found."""
    until = None if seconds is None else time.monotonic() + seconds
    slots = few_slots.first(problem)
    while True:
        few = replace(problem, slots=slots)
        laid = arrays(few)
        best = _best(few, laid, until)
        if best is None:
            if slots == problem.slots or (needed := room(problem)) is None:
                return None
            slots = {robot: max(slots[robot], needed[robot]) for robot in slots}
            continue
        least = _least(few, laid, best, until)
        taken = ([laid.places[place][0] for place in one.outcome.places] for one in (best, least))
        wider = few_slots.more(problem, slots, taken)
        if wider is None:
            break
        slots = wider
    pairs = zip(best.outcome.items, best.outcome.places, strict=True)
    return Decision(
        chosen=tuple((laid.names[item], *laid.places[place]) for item, place in pairs),
        pools=tuple(pool for item in best.outcome.items for pool in laid.items[item].pools),
        spared=_units(laid, best.outcome) - _units(laid, least.outcome),
        gap=max(best.gap, least.gap),
    )


def run(table: ProblemTable, until: float | None = None) -> Selection | None:
    """Return the cheapest choice of a table by the method that fits it, or None when there is none.

    With a limit, by time.monotonic(), the best found by then; None when none was.
    """
    if table.plain:
        return flow(table)
    return solve_table(table, None if until is None else max(0.0, until - time.monotonic()))


class _Best(msgspec.Struct, frozen=True):
    """A choice, and by how much another could be better in what was minimised."""

    outcome: Selection
    gap: int
    """Millionths."""


def _best(problem: Problem, laid: Arrays, until: float | None) -> _Best | None:
    if not problem.sticky or not laid.moves.any():
        return _free(laid, laid.wanted, until)
    # where everything can stay that could stay alone, fewer moves are not possible, and only the cost is left to decide
    stay = run(laid.table(laid.wanted, laid.fewest()), until)
    if stay is not None:
        return _Best(stay, stay.cost - stay.bound)
    factor = 1 + laid.nodes * int(laid.wanted[laid.allowed].max(initial=0))
    found = run(laid.table(laid.sticky(laid.wanted)), until)
    return None if found is None else _Best(found, (found.cost - found.bound) % factor)


def _free(laid: Arrays, wanted: Array, until: float | None) -> _Best | None:
    factor = 1 + int(laid.moves.max(axis=1, initial=0).sum())
    found = run(laid.table(laid.free(wanted)), until)
    return None if found is None else _Best(found, found.cost // factor - found.bound // factor)


def _least(problem: Problem, laid: Arrays, best: _Best, until: float | None) -> _Best:
    """Return the choice of least cost, which stickiness and fairness may keep from being the best."""
    if (laid.wanted == laid.cost).all() and not (problem.sticky and laid.moves.any()):
        return best
    cheapest = _free(laid, laid.cost, until)
    assert cheapest is not None or until is not None, "stickiness and fairness change costs, not what is possible"
    # where the time is over nothing is known of another choice, except that it costs something
    return cheapest or _Best(best.outcome, max(1, _units(laid, best.outcome)))


def _units(laid: Arrays, found: Selection) -> int:
    return sum(int(laid.cost[pair]) for pair in zip(found.items, found.places, strict=True))
