"""Who runs what: the exact answer, by min-cost flow.

Takes a Problem, gives an Assignment or raises NoAssignment. Pure and deterministic: nodes and arcs are made in name
order.

Source: the paper's min-cost max-flow by cost-scaling push-relabel, which is OR-Tools' `SimpleMinCostFlow`. Every node
(a service, or services that must share a robot) sends one unit to a slot of a robot, every slot takes one. Arc costs
are integers:

    unit      = round(cost * SCALE), SCALE = 1 000 000
    free      = unit * (services + 1) + moves      lower cost first, then fewer services that leave their robot
    sticky    = moves * (1 + largest possible sum of units) + unit      the other way round

so both orders are lexicographic and exact. With `sticky` a service stays unless no placement at all lets it, and then
as few as possible move. What is equal in both is decided by the solver, which sees the same input each time.
"""

from __future__ import annotations

from collections.abc import Mapping

from srprov.assignment import explain
from srprov.assignment.cost import jain
from srprov.assignment.model import Assignment, Move, Node, Problem, RunnerUp
from srprov.errors import SrprovError

SCALE = 1_000_000
"""Units per 1.0 of cost: costs are compared to a millionth."""

Chosen = dict[Node, tuple[str, int]]
"""Node -> (robot, slot)"""


def solve(problem: Problem) -> Assignment:
    """Give the best assignment: see the module for what best means.

    Raises:
        NoAssignment: Some services can't all be placed; says which, and what would help.
    """
    chosen = _flow(problem, sticky=problem.sticky)
    if chosen is None:
        raise explain.no_assignment(problem)
    cheapest = _flow(problem, sticky=False) if problem.sticky and problem.previous else chosen
    assert cheapest is not None, "stickiness changes costs, not what is possible"
    placed = dict(problem.frozen) | {name: robot for node, (robot, _) in chosen.items() for name in node}
    slot_of = {name: slot for node, (_, slot) in chosen.items() for name in node}
    terms = {
        name: problem.cost(name, robot, slot_of.get(name, 0))
        for name, robot in sorted(placed.items())
        if robot in problem.loads
    }
    cost = sum(term.total for term in terms.values())
    spared = sum(problem.node_cost(node, *chosen[node]) - problem.node_cost(node, *cheapest[node]) for node in chosen)
    optimal = _units(problem, chosen) == _units(problem, cheapest)
    return Assignment(
        placed=dict(sorted(placed.items())),
        cost=cost,
        terms=terms,
        optimal=optimal,
        least=cost if optimal else cost - spared,
        moves=_moves(problem, placed),
        frozen=tuple(sorted(problem.frozen)),
        matrix={name: _row(problem, name) for name in problem.misses},
        why_not={name: explain.why_not(problem, name) for name in problem.misses},
        runner_up=_runners_up(problem, chosen),
        jain=jain(sum(terms[s].total for s in terms if placed[s] == robot) for robot in problem.loads),
        notes=_notes(problem),
    )


def _flow(problem: Problem, *, sticky: bool) -> Chosen | None:
    """Give the best slot for every node, or None when there is none for some."""
    from ortools.graph.python import min_cost_flow  # heavy: only when something is decided

    nodes, flow = problem.nodes, min_cost_flow.SimpleMinCostFlow()
    node_at = {node: index for index, node in enumerate(nodes)}
    places = [(robot, slot) for robot in problem.slots for slot in range(problem.slots[robot])]
    sink, place_at = len(nodes) + len(places), {place: len(nodes) + i for i, place in enumerate(places)}
    arcs = _arcs(problem, sticky=sticky)
    for (node, place), price in arcs.items():
        flow.add_arc_with_capacity_and_unit_cost(node_at[node], place_at[place], 1, price)
    for place in places:
        flow.add_arc_with_capacity_and_unit_cost(place_at[place], sink, 1, 0)
    for index in range(len(nodes)):
        flow.set_node_supply(index, 1)
    flow.set_node_supply(sink, -len(nodes))
    status = flow.solve()
    if status == flow.INFEASIBLE:
        return None
    if status != flow.OPTIMAL:
        raise SrprovError(f"the min-cost flow solver gave up: {status.name}", hint="this is a bug of srprov")
    return {node: place for i, (node, place) in enumerate(arcs) if flow.flow(i)}


def _arcs(problem: Problem, *, sticky: bool) -> dict[tuple[Node, tuple[str, int]], int]:
    """Give the integer cost of every possible (node, (robot, slot)), in the order the solver gets them."""
    units = {
        (node, (robot, slot)): round(problem.node_cost(node, robot, slot) * SCALE)
        for node in problem.nodes
        for robot in problem.eligible(node)
        for slot in range(problem.slots[robot])
    }
    services = sum(len(node) for node in problem.nodes)
    largest = 1 + len(problem.nodes) * max(units.values(), default=0)
    moves = {(node, place): problem.moved(node, place[0]) for node, place in units}
    if sticky:
        return {arc: moves[arc] * largest + unit for arc, unit in units.items()}
    return {arc: unit * (services + 1) + moves[arc] for arc, unit in units.items()}


def _units(problem: Problem, chosen: Chosen) -> int:
    return sum(round(problem.node_cost(node, *place) * SCALE) for node, place in chosen.items())


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


def _row(problem: Problem, service: str) -> dict[str, float | None]:
    lacking = problem.misses[service]
    return {
        robot: None if robot in lacking or robot not in problem.loads else problem.cost(service, robot).total
        for robot in problem.robots
    }


def _runners_up(problem: Problem, chosen: Chosen) -> dict[str, RunnerUp]:
    """Give the best other robot of each service, in its first slot that is free; in its very first when it is full."""
    used: dict[str, int] = {}
    for robot, _ in chosen.values():
        used[robot] = used.get(robot, 0) + 1
    found: dict[str, RunnerUp] = {}
    for node, (robot, slot) in chosen.items():
        now, others = problem.node_cost(node, robot, slot), []
        for other in problem.eligible(node):
            full = used.get(other, 0) >= problem.slots[other]
            cost = problem.node_cost(node, other, 0 if full else used.get(other, 0))
            if other != robot:
                others.append(RunnerUp(robot=other, cost=cost, difference=cost - now, full=full))
        if others:
            best = min(others, key=lambda runner: (runner.cost, runner.robot))
            found.update(dict.fromkeys(node, best))
    return dict(sorted(found.items()))
