"""The contour plots show the functions that decide, which are the paper's."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.assignment import contours


@pytest.mark.parametrize(
    ("name", "formula"),
    [
        ("CPU load", lambda alpha, beta: alpha * beta**4),
        ("memory load (the paper's VRAM)", lambda alpha, beta: alpha * beta**4),
        ("swap load", lambda alpha, beta: alpha * beta),
        ("bandwidth", lambda alpha, beta: alpha * (1 - beta) ** 4),
    ],
)
def test_a_surface_is_the_papers_formula(name: str, formula: object) -> None:
    found = contours.surface(contours.PANELS[name][2])
    assert callable(formula)
    for row, column in ((0, 25), (50, 0), (50, 25), (20, 40), (50, 50)):
        assert found[row][column] == pytest.approx(formula(2 * row, column / 50)), (row, column)


def test_there_is_a_plot_of_all_four(tmp_path: Path) -> None:
    contours.draw(tmp_path / "plot.svg")
    assert all(f"<!-- {title}: " in (tmp_path / "plot.svg").read_text() for title in contours.PANELS)
