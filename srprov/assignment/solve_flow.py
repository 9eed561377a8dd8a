"""The paper's min-cost flow, for tables that have nothing but nodes and places.

Takes a Table, gives an Outcome, or None when not every node finds a place. Pure and deterministic.

Source: the paper's min-cost max-flow by cost-scaling push-relabel, which is OR-Tools' `SimpleMinCostFlow`: every node
sends one unit to a place, every place passes one on.
"""

from __future__ import annotations

import numpy as np

from srprov.assignment.model import Problem
from srprov.assignment.table import NEVER, Array, ProblemTable, Selection, outcome
from srprov.codes import Code
from srprov.errors import SrprovError


def flow(table: ProblemTable) -> Selection | None:
    """Return the cheapest choice of one place per node, alone; items beyond the nodes are not looked at."""
    nodes = table.nodes
    found = assign(table.cost[:nodes], table.allowed[:nodes])
    return None if found is None else outcome(table, range(nodes), found)


def assign(cost: Array, allowed: Array, room: Array | None = None) -> Array | None:
    """Return int64 [N], the place of every row at least cost, or None; `cost` int64 and `allowed` bool are [N, P].

    `room`, int64 [P], says how many rows a place takes; None: one each.
    """
    from ortools.graph.python import min_cost_flow  # heavy: only when something is decided

    nodes, places = cost.shape
    solver = min_cost_flow.SimpleMinCostFlow()
    row, column = np.nonzero(allowed)
    arcs = solver.add_arcs_with_capacity_and_unit_cost(row, column + nodes, np.ones_like(row), cost[row, column])
    ends = np.arange(places)
    sink = nodes + places
    solver.add_arcs_with_capacity_and_unit_cost(
        ends + nodes, np.full(places, sink), np.ones_like(ends) if room is None else room, np.zeros_like(ends)
    )
    solver.set_nodes_supplies(np.arange(nodes), np.ones(nodes, dtype=np.int64))
    solver.set_node_supply(sink, -nodes)
    status = solver.solve()
    if status == solver.INFEASIBLE:
        return None
    if status != solver.OPTIMAL:
        raise SrprovError(
            f"the placement could not be computed: the min-cost flow solver gave up ({status.name})",
            hint="this is a bug of srprov",
            code=Code.BUG,
        )
    used = solver.flows(arcs) > 0
    found = np.empty(nodes, dtype=np.int64)
    found[row[used]] = column[used]
    return found


def room(problem: Problem) -> dict[str, int] | None:
    """Return how many slots of each robot are enough for all nodes, with one to spare where there is one; or None."""
    robots = list(problem.loads)
    allowed = np.array([[robot in problem.eligible(node) for robot in robots] for node in problem.nodes])
    most = np.array([problem.slots[robot] for robot in robots])
    found = assign(np.zeros(allowed.shape, dtype=np.int64), allowed, most)
    if found is None:
        return None
    used = np.bincount(found, minlength=len(robots))
    return {robot: min(problem.slots[robot], int(count) + 1) for robot, count in zip(robots, used, strict=True)}


def potentials(priced: Array, found: Array, rounds: int | None = None) -> tuple[Array, Array]:
    """Return the flow's dual values: u [N] and v [P] <= 0 with u + v <= cost everywhere, equal where it was chosen.

    Args:
        priced: int64 [N, P], NEVER where not allowed.
        found: int64 [N], an optimal choice.
        rounds: Stop after so many, with prices that are not exact; None for as many as it takes.

    Shortest paths in the residual graph by Bellman-Ford over whole rows; at an optimum there is no negative cycle.
    """
    own = priced[np.arange(len(found)), found]
    v = np.zeros(priced.shape[1], dtype=np.int64)
    for _ in range(2 * len(found) + 2 if rounds is None else rounds):
        u = own - v[found]
        lower = np.minimum(v, (np.minimum(priced, NEVER // 4) - u[:, None]).min(axis=0, initial=0))
        if np.array_equal(lower, v):
            break
        v = lower
    return own - v[found], v
