"""What a design can tell is said before anything is run, and is so afterwards."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from srprov.controller.trial_values import design_notes, listed
from srprov.definitions import load_experiment
from srprov.definitions.trialsmodel import Margin
from srprov.evidence.effects import bounds, effect, judged
from srprov.trials.power import most_scatter

EDF = """\
edf: 1
name: race
services: {a: {image: x}}
parameters: {SPEED: [1, 2]}
trials: {repetitions: 10, seed: 1, timeout: 5s}
metrics:
  time: {service: a, log: '(x)', unit: s, margin: 0.5}
  steps: {service: a, log: '(x)', margin: 10%}
  more: {service: a, log: '(x)'}
"""


@pytest.mark.parametrize(
    ("points", "repetitions", "margin"),
    [(1, 10, Margin(2.0)), (3, 5, Margin(2.0)), (2, 10, Margin(0.1, relative=True))],
)
def test_equal_runs_with_just_that_scatter_are_equivalent_nine_times_of_ten(
    points: int, repetitions: int, margin: Margin
) -> None:
    scatter = most_scatter(points, repetitions, margin)
    assert scatter is not None
    random_ = random.Random(5)
    width = 100 * scatter if margin.relative else scatter

    def side() -> dict[str, list[float]]:
        return {str(one): [random_.gauss(100, width) for _ in range(repetitions)] for one in range(points)}

    count, equivalent = 400, 0
    for _ in range(count):
        found = effect(side(), side(), ratio=margin.relative)
        equivalent += judged(found, bounds(margin, found, 100.0)) == "equivalent"
    assert 0.85 < equivalent / count < 0.96


def test_more_trials_and_wider_margins_stand_more_scatter() -> None:
    less, more, wider = (most_scatter(1, n, Margin(m)) for n, m in ((5, 1), (20, 1), (5, 3)))
    assert less is not None and more is not None and wider == pytest.approx(3 * less)
    assert more > 2 * less


@pytest.mark.parametrize(("points", "repetitions"), [(1, 4), (10, 1), (2, 2)])
def test_too_few_trials_tell_nothing(points: int, repetitions: int) -> None:
    assert most_scatter(points, repetitions, Margin(1)) is None


def test_a_plan_and_the_list_of_trials_say_it_of_each_metric_with_a_margin(tmp_path: Path) -> None:
    (tmp_path / "race.edf").write_text(EDF)
    experiment = load_experiment(tmp_path / "race.edf").experiment
    _, steps, time = design_notes(experiment.trials)
    assert listed(experiment)[1][1:] == (steps, time)
    assert steps.startswith("steps, margin 10 %: two equal runs come out equivalent nine times of ten if trials")
    assert steps.endswith("scatter by up to 9.04 %") and time.endswith("scatter by up to 0.474")
    assert time.startswith("time, margin 0.5 s: ")
    (tmp_path / "race.edf").write_text(EDF.replace("repetitions: 10", "repetitions: 1"))
    few = design_notes(load_experiment(tmp_path / "race.edf").experiment.trials)
    assert "cannot be compared, with fewer than 2 repetitions or 5 trials" in few[1]
