"""The cost matrix as a picture: services by robots, what was chosen in a frame, what cannot be in grey.

Takes an Assignment; writes SVG or PNG. The only file of the command line that needs matplotlib.
"""

from __future__ import annotations

import contextlib
import io
import math
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from srprov import private
from srprov.codes import Code
from srprov.errors import UsageError

if TYPE_CHECKING:
    from srprov.assignment.fairness import Point
    from srprov.assignment.model import Assignment

_WRITTEN = 400
"""Cells up to which each has its number."""


def draw(answer: Assignment, front: Sequence[Point], target: Path, form: str) -> None:
    """Draw the matrix, and beside it the Pareto front when there is one.

    Raises:
        UsageError: Nothing is placed, or matplotlib is not installed.
        OSError: It cannot be written.
    """
    if not answer.matrix:
        raise UsageError(
            "nothing is placed, so there is no picture", hint="leave out --svg and --png", code=Code.NO_PLACEMENT
        )
    try:
        with _elsewhere():
            import matplotlib

        matplotlib.use("agg")
        from matplotlib.figure import Figure
    except ImportError as error:
        raise UsageError(
            "pictures need matplotlib", hint="pip install 'matplotlib>=3.8'", code=Code.NOT_INSTALLED
        ) from error
    matplotlib.rcdefaults()  # a user's own `matplotlibrc` may run LaTeX (text.usetex) on names in an experiment
    matplotlib.rcParams["svg.hashsalt"] = "srprov"
    matplotlib.rcParams["text.parse_math"] = False  # a name with two $ is a name, no formula
    robots = sorted({robot for row in answer.matrix.values() for robot in row})
    width, height = 2.5 + 0.6 * len(robots), 1.6 + 0.35 * len(answer.matrix)
    figure = Figure(
        figsize=(min(width, 40) + (4 if front else 0), min(max(height, 3.0 if front else 0), 40)), layout="constrained"
    )
    shape: Any = figure.subplots(1, 2, width_ratios=[max(width, 4), 4]) if front else [figure.subplots()]
    _matrix(shape[0], answer, robots)
    if front:
        shape[1].plot([point.cost for point in front], [point.jain for point in front], "o-", color="#2a5d84")
        for point in front:
            shape[1].annotate(
                f"{point.fairness:g}", (point.cost, point.jain), textcoords="offset points", xytext=(4, -9)
            )
        shape[1].set(xlabel="cost", ylabel="Jain's index", title="fairness")
    picture = io.BytesIO()
    figure.savefig(picture, format=form, metadata={"Date": None} if form == "svg" else {})
    private.write_output(str(target), picture.getvalue())  # a link there may be a stranger's


@contextlib.contextmanager
def _elsewhere() -> Iterator[None]:
    """Be in the root folder meanwhile: matplotlib reads `matplotlibrc` of the current one when it is imported."""
    here = os.getcwd()
    try:
        os.chdir("/")
        yield
    finally:
        os.chdir(here)


def _matrix(axes: Any, answer: Assignment, robots: Sequence[str]) -> None:  # noqa: ANN401 - matplotlib has no stubs
    services = list(answer.matrix)
    values = [[_number(answer.matrix[service].get(robot)) for robot in robots] for service in services]
    axes.set_facecolor("#d9d9d9")
    picture = axes.imshow(values, cmap="viridis_r", aspect="auto", vmin=0)
    axes.figure.colorbar(picture, ax=axes, label="cost")
    axes.set_xticks(range(len(robots)), robots, rotation=45, ha="right")
    axes.set_yticks(range(len(services)), services)
    for row, service in enumerate(services):
        for column, robot in enumerate(robots):
            value = values[row][column]
            if len(services) * len(robots) <= _WRITTEN and not math.isnan(value):
                axes.text(column, row, f"{value:.2f}", ha="center", va="center", fontsize=7, color="#d04a00")
            if answer.placed.get(service) == robot:
                axes.add_patch(_frame(column, row))
    axes.set_title(f"cost {answer.cost:.3f}" + (", the least possible" if answer.optimal else ""))


def _number(value: float | None) -> float:
    return math.nan if value is None else value


def _frame(column: int, row: int) -> Any:  # noqa: ANN401 - matplotlib has no stubs
    from matplotlib.patches import Rectangle

    return Rectangle((column - 0.48, row - 0.46), 0.96, 0.92, fill=False, edgecolor="#d04a00", linewidth=2)
