"""Comparisons that are drawn from one run are right as often as its scatter lets them be."""

from __future__ import annotations

import random

from benchmarks.evidence.false_alarms import predicted, rate, table


def test_rates_are_near_what_is_predicted() -> None:
    random_ = random.Random(3)
    points = {name: [random_.lognormvariate(3, 0.1) for _ in range(20)] for name in "pq"}
    same, twice = table(points, 0.1, 200, 1)[2:]
    assert 0.9 < predicted(points, 0, 0.1) < 1 and int(same.split("|")[2].split("%")[0]) >= 80
    assert int(same.split("|")[4].split("%")[0]) <= 2, "no false alarm"
    assert int(twice.split("|")[4].split("%")[0]) >= 80
    assert twice.split("|")[2].strip().startswith("0 %")


def test_a_rate_has_an_interval() -> None:
    assert rate(0, 200) == "0 % [0, 2]"
    assert rate(100, 200) == "50 % [43, 57]"
