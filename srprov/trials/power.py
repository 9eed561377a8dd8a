"""What a comparison of two runs of a design can tell, before anything is run: by its size and a margin alone. Pure.

Source: Schuirmann 1987 (two one-sided tests); the scatter is that of normally distributed values, equal at all points.
"""

from __future__ import annotations

import math
from statistics import NormalDist

from srprov.definitions.trialsmodel import Margin, Metric, TrialDefinitions
from srprov.trials import student
from srprov.trials.design import Design

FEWEST_TRIALS = 5
"""A side; below that no interval says anything."""
CONFIDENCE = 0.90
"""Of an interval: inside of a margin it is two one-sided tests at 5 %."""
SURE = 0.90
"""How often the answer shall come."""


def most_scatter(points: int, repetitions: int, margin: Margin) -> float | None:
    """Return how much trials may scatter for two runs that do not differ to be found equivalent nine times of ten.

    Args:
        points: Of the design.
        repetitions: Of each.
        margin: How much may differ.

    Returns:
        A standard deviation between trials of one point: in the metric's unit, of a relative margin a share of the
        value. None: there are too few trials for any answer.
    """
    if repetitions < 2 or points * repetitions < FEWEST_TRIALS:
        return None
    width = math.log1p(margin.value) if margin.relative else margin.value
    test = student.quantile((1 + CONFIDENCE) / 2, 2 * points * (repetitions - 1))
    both = NormalDist().inv_cdf((1 + SURE) / 2)
    return width / (test + both) * math.sqrt(points * repetitions / 2)


def in_words(given: TrialDefinitions, made: Design) -> list[str]:
    """Return a line for each metric that has a margin."""
    return [_line(one, one.margin, given, made) for one in given.metrics if one.margin is not None]


def _line(one: Metric, margin: Margin, given: TrialDefinitions, made: Design) -> str:
    head = f"{one.name}, margin {margin.text}{'' if margin.relative or not one.unit else f' {one.unit}'}"
    scatter = most_scatter(len(made.points), given.settings.repetitions, margin)
    if scatter is None:
        return f"{head}: two such runs cannot be compared, with fewer than 2 repetitions or {FEWEST_TRIALS} trials"
    most = f"{100 * scatter:.3g} %" if margin.relative else f"{scatter:.3g}"
    return f"{head}: two equal runs come out equivalent nine times of ten if trials scatter by up to {most}"
