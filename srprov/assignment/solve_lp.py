"""The two general solvers that the exact method leans on, behind two small doors: GLOP that grows, and HiGHS.

Takes sparse columns as numpy arrays; gives numpy arrays. Pure. Both are part of OR-Tools and are called with whole
arrays, since making one Python object per column would take longer than solving.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from srprov.assignment.table import Array
from srprov.codes import Code
from srprov.errors import SrprovError


class Growing:
    """A linear program `min cost x, low <= Ax <= 1, x >= 0` that gets more columns and is solved again from there."""

    def __init__(self, low: Array) -> None:
        """Take float [R]: 1 for rows that must be covered, -inf for those that may be."""
        self._low = low
        self._columns = 0
        self._solver: Any = None

    def add(self, rows: Array, columns: Array, cost: Array) -> None:
        """Add columns: float [C] costs; (row, column 0..C-1) of every 1 of the matrix."""
        from ortools.math_opt import model_pb2, model_update_pb2, parameters_pb2
        from ortools.math_opt.core.python import solver
        from ortools.math_opt.python.parameters import SolverType

        first, self._columns = self._columns, self._columns + len(cost)
        if self._solver is None:
            model = model_pb2.ModelProto()
            _rows(model.linear_constraints, self._low, np.ones(len(self._low)))
            _columns(model.variables, 0, len(cost), math.inf, whole=False)
            _costs(model.objective.linear_coefficients, 0, cost)
            _matrix(model.linear_constraint_matrix, rows, columns)
            self._solver = solver.new(SolverType.GLOP.value, model, parameters_pb2.SolverInitializerProto())
            return
        update = model_update_pb2.ModelUpdateProto()
        _columns(update.new_variables, first, len(cost), math.inf, whole=False)
        _costs(update.objective_updates.linear_coefficients, first, cost)
        _matrix(update.linear_constraint_matrix_updates, rows, columns + first)
        if not self._solver.update(update):
            raise SrprovError(
                "the placement could not be computed: GLOP did not take new columns",
                hint="this is a bug of srprov",
                code=Code.BUG,
            )

    def add_row(self, columns: Array, most: float) -> None:
        """Add a row: at most so much of some columns, by their position in all that were added."""
        from ortools.math_opt import model_update_pb2

        row, self._low = len(self._low), np.append(self._low, -np.inf)
        update = model_update_pb2.ModelUpdateProto()
        update.new_linear_constraints.ids.append(row)
        update.new_linear_constraints.lower_bounds.append(-math.inf)
        update.new_linear_constraints.upper_bounds.append(most)
        _matrix(update.linear_constraint_matrix_updates, np.full(len(columns), row), columns)
        if not self._solver.update(update):
            raise SrprovError(
                "the placement could not be computed: GLOP did not take a new row",
                hint="this is a bug of srprov",
                code=Code.BUG,
            )

    def reprice(self, columns: Array, cost: float) -> None:
        """Return columns, by their position in all that were added, another cost."""
        from ortools.math_opt import model_update_pb2

        update = model_update_pb2.ModelUpdateProto()
        into = update.objective_updates.linear_coefficients
        into.ids.extend(sorted(columns.tolist()))
        into.values.extend([cost] * len(columns))
        if not self._solver.update(update):
            raise SrprovError(
                "the placement could not be computed: GLOP did not take new costs",
                hint="this is a bug of srprov",
                code=Code.BUG,
            )

    def solve(self, seconds: float | None = None) -> tuple[float, Array, Array] | None:
        """Return the least cost, float [columns] the choice and float [R] the dual values; None: out of time."""
        from ortools.math_opt import callback_pb2, model_parameters_pb2, parameters_pb2, result_pb2

        parameters = parameters_pb2.SolveParametersProto()
        # what is off by rounding only makes the bound weaker, which is computed apart from this
        parameters.glop.change_status_to_imprecise = False
        if seconds is not None:
            parameters.time_limit.FromNanoseconds(int(seconds * 1e9))
        result = self._solver.solve(
            parameters,
            model_parameters_pb2.ModelSolveParametersProto(),
            None,
            callback_pb2.CallbackRegistrationProto(),
            None,
            None,
        )
        if seconds is not None and result.termination.reason != result_pb2.TERMINATION_REASON_OPTIMAL:
            return None  # what there is by then need not be feasible
        if not result.solutions or not result.solutions[0].HasField("dual_solution"):
            raise SrprovError(
                f"the placement could not be computed: GLOP gave up ({result.termination.detail})",
                hint="this is a bug of srprov",
                code=Code.BUG,
            )
        solution = result.solutions[0]
        primal, dual = solution.primal_solution, solution.dual_solution
        chosen = _dense(primal.variable_values, self._columns)
        return primal.objective_value, chosen, _dense(dual.dual_values, len(self._low))


def whole(
    low: Array, high: Array, rows: Array, columns: Array, cost: Array, seconds: float | None
) -> tuple[Array | None, float, bool]:
    """Solve `min cost x, low <= Ax <= high, x in {0, 1}` by HiGHS.

    Args:
        low: float [R]: 1 for rows that must be covered, -inf for those that may be.
        high: float [R].
        rows: The row of every 1 of the matrix.
        columns: Its column, 0..C-1.
        cost: float [C].
        seconds: Time limit, or None.

    Returns:
        bool [C] the choice or None, a bound that no choice goes below, and whether the choice is proved best.
    """
    import datetime

    from ortools.math_opt import model_pb2
    from ortools.math_opt.python import mathopt

    model = model_pb2.ModelProto()
    _rows(model.linear_constraints, low, high)
    _columns(model.variables, 0, len(cost), 1.0, whole=True)
    _costs(model.objective.linear_coefficients, 0, cost)
    _matrix(model.linear_constraint_matrix, rows, columns)
    parameters = mathopt.SolveParameters(
        relative_gap_tolerance=0.0,
        absolute_gap_tolerance=0.0,
        time_limit=None if seconds is None else datetime.timedelta(seconds=seconds),
    )
    result = mathopt.solve(mathopt.Model.from_model_proto(model), mathopt.SolverType.HIGHS, params=parameters)
    done = result.termination.reason == mathopt.TerminationReason.OPTIMAL
    if result.termination.reason == mathopt.TerminationReason.INFEASIBLE:
        return None, math.inf, True
    chosen: Array | None = None
    if result.has_primal_feasible_solution():
        chosen = np.zeros(len(cost), dtype=bool)
        for variable, value in result.variable_values().items():
            chosen[variable.id] = value > 0.5
    return chosen, result.termination.objective_bounds.dual_bound, done


def _rows(into: Any, low: Array, high: Array) -> None:  # noqa: ANN401 - a protocol buffer message
    into.ids.extend(range(len(low)))
    into.lower_bounds.extend(low.tolist())
    into.upper_bounds.extend(high.tolist())


def _columns(into: Any, first: int, count: int, upper: float, *, whole: bool) -> None:  # noqa: ANN401
    into.ids.extend(range(first, first + count))
    into.lower_bounds.extend([0.0] * count)
    into.upper_bounds.extend([upper] * count)
    into.integers.extend([whole] * count)


def _costs(into: Any, first: int, cost: Array) -> None:  # noqa: ANN401
    into.ids.extend(range(first, first + len(cost)))
    into.values.extend(cost.tolist())


def _matrix(into: Any, rows: Array, columns: Array) -> None:  # noqa: ANN401
    order = np.lexsort((columns, rows))
    into.row_ids.extend(rows[order].tolist())
    into.column_ids.extend(columns[order].tolist())
    into.coefficients.extend([1.0] * len(rows))


def _dense(values: Any, size: int) -> Array:  # noqa: ANN401 - a sparse vector message
    full = np.zeros(size)
    full[np.array(values.ids, dtype=np.int64)] = np.array(values.values)
    return full
