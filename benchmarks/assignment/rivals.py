"""General solvers on the same instances: HiGHS and CP-SAT on the full model; SciPy and networkx without pools."""

from __future__ import annotations

import datetime
import math
import time

import numpy as np
from ortools.math_opt import model_pb2
from ortools.math_opt.python import mathopt

from srprov.assignment.table import NEVER, Members, ProblemTable

Timed = tuple[float, int | None, bool]
"""Seconds, cost in millionths or None, proved."""


def full_model(table: ProblemTable) -> mathopt.Model:
    """Write the whole model down: a variable per allowed pair, a row per service and per place."""
    item, place = np.nonzero(table.allowed)
    row, column = Members(table.items, table.nodes).rows(item)
    rows = np.concatenate([row, table.nodes + place])
    columns = np.concatenate([column, np.arange(len(item))])
    order, count = np.lexsort((columns, rows)), table.nodes + table.cost.shape[1]
    model = model_pb2.ModelProto()
    model.variables.ids.extend(range(len(item)))
    model.variables.lower_bounds.extend([0.0] * len(item))
    model.variables.upper_bounds.extend([1.0] * len(item))
    model.variables.integers.extend([True] * len(item))
    model.objective.linear_coefficients.ids.extend(range(len(item)))
    model.objective.linear_coefficients.values.extend((table.cost[item, place] / 1e6).tolist())
    model.linear_constraints.ids.extend(range(count))
    model.linear_constraints.lower_bounds.extend([1.0] * table.nodes + [-math.inf] * table.cost.shape[1])
    model.linear_constraints.upper_bounds.extend([1.0] * count)
    model.linear_constraint_matrix.row_ids.extend(rows[order].tolist())
    model.linear_constraint_matrix.column_ids.extend(columns[order].tolist())
    model.linear_constraint_matrix.coefficients.extend([1.0] * len(rows))
    return mathopt.Model.from_model_proto(model)


def general(table: ProblemTable, solver: str, limit_s: float) -> Timed:
    """Solve by `highs` or `cp_sat` (two threads); what is timed is the solver alone, not writing the model down."""
    model = full_model(table)
    kinds = {"highs": mathopt.SolverType.HIGHS, "cp_sat": mathopt.SolverType.CP_SAT}
    parameters = mathopt.SolveParameters(
        relative_gap_tolerance=0.0,
        time_limit=datetime.timedelta(seconds=limit_s),
        threads=2 if solver == "cp_sat" else None,
    )
    begun = time.perf_counter()
    result = mathopt.solve(model, kinds[solver], params=parameters)
    took = time.perf_counter() - begun
    done = result.termination.reason == mathopt.TerminationReason.OPTIMAL
    cost = round(result.objective_value() * 1e6) if result.has_primal_feasible_solution() else None
    return took, cost, done


def scipy_assignment(table: ProblemTable) -> Timed:
    """Solve by SciPy's linear_sum_assignment; nodes alone."""
    from scipy.optimize import linear_sum_assignment

    cost = np.where(table.allowed[: table.nodes], table.cost[: table.nodes], 1e15).astype(float)
    begun = time.perf_counter()
    rows, columns = linear_sum_assignment(cost)
    took = time.perf_counter() - begun
    return took, int(table.cost[rows, columns].sum()), True


def networkx_flow(table: ProblemTable) -> Timed:
    """Solve by networkx' network simplex; nodes alone."""
    import networkx

    graph = networkx.DiGraph()
    for node in range(table.nodes):
        graph.add_node(("s", node), demand=-1)
    graph.add_node("sink", demand=table.nodes)
    for node, place in zip(*np.nonzero(table.allowed[: table.nodes]), strict=True):
        graph.add_edge(("s", int(node)), ("r", int(place)), capacity=1, weight=int(table.cost[node, place]))
    for place in range(table.cost.shape[1]):
        graph.add_edge(("r", place), "sink", capacity=1, weight=0)
    begun = time.perf_counter()
    cost, _ = networkx.network_simplex(graph)
    return time.perf_counter() - begun, int(cost), True


def bare_flow(table: ProblemTable) -> Timed:
    """Solve by OR-Tools' SimpleMinCostFlow on the same arcs and nothing else; the time is the solver's alone."""
    from ortools.graph.python import min_cost_flow

    nodes, places = table.nodes, table.cost.shape[1]
    row, column = np.nonzero(table.allowed[:nodes])
    cost, ends = table.cost[row, column], np.arange(places)
    begun = time.perf_counter()
    flow = min_cost_flow.SimpleMinCostFlow()
    flow.add_arcs_with_capacity_and_unit_cost(row, column + nodes, np.ones_like(row), cost)
    sinks = np.full(places, nodes + places)
    flow.add_arcs_with_capacity_and_unit_cost(ends + nodes, sinks, np.ones_like(ends), np.zeros_like(ends))
    flow.set_nodes_supplies(np.arange(nodes), np.ones(nodes, dtype=np.int64))
    flow.set_node_supply(nodes + places, -nodes)
    flow.solve()
    took = time.perf_counter() - begun
    return took, int(flow.optimal_cost()), bool(NEVER)
