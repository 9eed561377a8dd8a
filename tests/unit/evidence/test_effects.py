"""Differences with intervals: against tables, and how often they are wrong."""

from __future__ import annotations

import math
import random
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from srprov.definitions.trialsmodel import Margin
from srprov.evidence.effects import (
    Effect,
    TooFew,
    bounds,
    chance,
    effect,
    holm,
    judged,
    needed,
    shares,
)
from srprov.trials import student

FEW = st.lists(st.floats(-1e6, 1e6), min_size=5, max_size=12)


@pytest.mark.parametrize(
    ("df", "quantile"),
    [(1, 6.313752), (2, 2.919986), (3, 2.353363), (5, 2.015048), (10, 1.812461), (30, 1.697261), (120, 1.657651)],
)
def test_quantiles_are_those_of_the_tables(df: int, quantile: float) -> None:
    """Source: NIST/SEMATECH e-Handbook of Statistical Methods, 1.3.6.7.2."""
    assert student.quantile(0.95, df) == pytest.approx(quantile, abs=1e-6)
    assert student.cdf(quantile, df) == pytest.approx(0.95, abs=1e-7)
    assert student.cdf(-quantile, df) == pytest.approx(0.05, abs=1e-7)


@pytest.mark.parametrize("t", [-3.0, 0.0, 0.4, 20.0])
def test_one_and_two_degrees_of_freedom_and_endless_ones_are_as_their_formulas_say(t: float) -> None:
    assert student.cdf(t, 1) == pytest.approx(0.5 + math.atan(t) / math.pi, abs=1e-12)
    assert student.cdf(t, 2) == pytest.approx(0.5 + t / (2 * math.sqrt(2 + t * t)), abs=1e-12)
    assert student.cdf(t, math.inf) == pytest.approx(student.cdf(t, 1e9), abs=1e-6)


def test_welch_is_that_of_an_example() -> None:
    """Source: Welch's t test of the two samples by R 4.2, `t.test(b, a, conf.level = 0.9)`: df 7.1189."""
    a, b = [27.5, 21.0, 19.0, 23.6, 17.0], [27.1, 22.0, 20.8, 23.4, 23.4]
    found = effect({"p": a}, {"p": b})
    mean_a, mean_b = sum(a) / 5, sum(b) / 5
    parts = [sum((one - mean) ** 2 for one in some) / 4 / 5 for some, mean in ((a, mean_a), (b, mean_b))]
    df = sum(parts) ** 2 / sum(part**2 / 4 for part in parts)
    assert found.estimate == pytest.approx(mean_b - mean_a)
    assert (found.error, found.df) == pytest.approx((math.sqrt(sum(parts)), df))
    assert found.high - found.estimate == pytest.approx(student.quantile(0.95, df) * found.error)


def test_points_are_weighed_alike_and_those_of_one_side_do_not_count() -> None:
    found = effect({"p": [1, 2, 3], "q": [10, 12], "r": [5, 5]}, {"p": [2, 3, 4], "q": [13, 15, 17], "s": [1, 1]})
    assert (found.estimate, found.points, found.units) == (2.5, 2, (5, 6))


def test_too_few_values_have_no_interval() -> None:
    with pytest.raises(TooFew, match="4 and 5 values that compare, and 5 are needed"):
        effect({"p": [1, 2, 3, 4]}, {"p": [1, 2, 3, 4, 5]})
    with pytest.raises(TooFew):
        effect({"p": [1.0] * 9}, {"q": [1.0] * 9})
    with pytest.raises(TooFew, match="4 and 9 trials"):
        shares((4, 4), (9, 9))


def _effect(low: float, high: float, *, ratio: bool = False) -> Effect:
    middle = (low + high) / 2
    return Effect(estimate=middle, error=(high - low) / 4, df=20, low=low, high=high, units=(10, 10), ratio=ratio)


@pytest.mark.parametrize(
    ("low", "high", "grade"),
    [(-1, 1, "equivalent"), (-2, 2, "equivalent"), (-2.1, 1, "inconclusive"), (1, 3, "inconclusive"),
     (-9, 9, "inconclusive"), (2.1, 3, "different"), (-5, -2.5, "different"), (2, 3, "inconclusive")],
)  # fmt: skip
def test_an_interval_is_inside_a_margin_or_outside_of_it_or_neither(low: float, high: float, grade: str) -> None:
    found = _effect(low, high)
    assert judged(found, bounds(Margin(2), found, 0.0)) == grade


def test_relative_margins_are_of_a_or_ratios() -> None:
    assert bounds(Margin(0.1, relative=True), _effect(-1, 1), -50.0) == (-5, 5)
    low, high = bounds(Margin(0.1, relative=True), _effect(-1, 1, ratio=True), 0.0)
    assert (math.exp(low), math.exp(high)) == pytest.approx((0.9, 1.1))
    assert _effect(math.log(0.5), math.log(2), ratio=True).text == "+0 % [-50 %, +100 %]"


def test_a_difference_without_scatter_is_certain() -> None:
    found = effect({"p": [1.0] * 5}, {"p": [3.0] * 5})
    assert (found.low, found.high, chance(found, (-1, 1)), chance(found, (-2, 2))) == (2, 2, 0, 1)


def test_holm_is_that_of_an_example() -> None:
    """Source: Holm 1979, by hand: 4 x 0.005, 3 x 0.01, 2 x 0.03, 1 x 0.04, none below the one before."""
    given_ = {"a": 0.01, "b": 0.04, "c": 0.03, "d": 0.005}
    assert holm(given_) == pytest.approx({"d": 0.02, "a": 0.03, "c": 0.06, "b": 0.06})
    assert holm({}) == {}


def test_shares_are_those_of_newcombe() -> None:
    """Source: Newcombe 1998, table II, method 10, example (a): 56/70 - 48/80, 95 %: 0.0524 to 0.3339; here 90 %."""
    found = shares((48, 80), (56, 70))
    assert found.estimate == pytest.approx(0.2)
    assert 0.0524 < found.low < 0.2 < found.high < 0.3339
    assert shares((0, 10), (10, 10)).low > 0.6


@given(FEW, FEW)
def test_sides_are_mirrored(a: list[float], b: list[float]) -> None:
    one, other = effect({"p": a}, {"p": b}), effect({"p": b}, {"p": a})
    assert (one.estimate, one.low, one.high) == pytest.approx((-other.estimate, -other.high, -other.low))
    assert one.low <= one.estimate <= one.high


@given(*[st.lists(st.floats(-1e50, 1e50) | st.floats(-1e-290, 1e-290), min_size=5, max_size=8)] * 2)
def test_any_numbers_have_an_interval(a: list[float], b: list[float]) -> None:
    positive = [[abs(one) + 1e-308 for one in some] for some in (a, b)]
    for found in (effect({"p": a}, {"p": b}), effect({"p": positive[0]}, {"p": positive[1]}, ratio=True)):
        assert found.low <= found.estimate <= found.high and found.text
        assert judged(found, bounds(Margin(0.1, relative=True), found, 1.0)) and 0 <= chance(found, (-1, 1)) <= 1


@given(FEW, st.floats(0.001, 1e6))
def test_equal_sides_are_never_different(a: list[float], margin: float) -> None:
    found = effect({"p": a}, {"p": a})
    assert judged(found, bounds(Margin(margin), found, 0.0)) != "different"


def test_how_often_answers_are_wrong() -> None:
    """Of normal values with a scatter of 10 %, ten a side, and a margin of 10 %, as the guide to the margin says."""
    random_ = random.Random(1)
    counts = {shift: Counter[str]() for shift in (0.0, 0.1, 0.2)}
    for shift, found in counts.items():
        for _ in range(400):
            a, b = ([random_.gauss(100 * (1 + by), 10) for _ in range(10)] for by in (0.0, shift))
            one = effect({"p": a}, {"p": b}, ratio=True)
            found[judged(one, bounds(Margin(0.1, relative=True), one, 0.0))] += 1
    assert counts[0.0]["different"] <= 4 and 110 <= counts[0.0]["equivalent"] <= 200
    assert counts[0.1]["equivalent"] <= 36 and counts[0.1]["different"] <= 36, "at the margin: at most 5 % of each"
    assert 240 <= counts[0.2]["different"] <= 320


def test_as_many_as_are_said_to_be_needed_settle_it() -> None:
    """Nine times of ten, where there is no difference."""
    random_ = random.Random(2)

    def sample(count: int) -> list[float]:
        return [random_.gauss(100, 10) for _ in range(count)]

    settled = 0
    for _ in range(200):
        first = effect({"p": sample(10)}, {"p": sample(10)})
        times = needed(first, (-10, 10))
        again = effect({"p": sample(10 * times)}, {"p": sample(10 * times)})
        settled += judged(again, (-10, 10)) == "equivalent"
    assert settled >= 160
