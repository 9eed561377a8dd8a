"""What two sides measured -> how far apart they are, with an interval, and what a margin says of that. Pure.

The unit is a trial, or, where a side has several runs, a run: trials of one run share its day, its channel and its
batteries, so that more of them do not tell how runs differ.

Source: Welch 1947 and Satterthwaite 1946 (unequal variances); Schuirmann 1987 (two one-sided tests); Newcombe 1998,
method 10 (shares); Holm 1979 (several tests).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from statistics import fmean, variance

import msgspec

from srprov.definitions.trialsmodel import Margin
from srprov.trials import student
from srprov.trials.power import CONFIDENCE, FEWEST_TRIALS

_TAIL = (1 - CONFIDENCE) / 2
_Z = 1.6448536269514722
"""Of the normal distribution, for the same confidence."""
_MOST_RATIO = 700.0
"""Logarithm of what still is a number."""
FEWEST_RUNS = 3
"""A side, where each has several; as for trials, below that no interval says anything."""
Values = Mapping[str, Sequence[float]]
"""Point of the design -> what its trials gave."""


class Effect(msgspec.Struct, frozen=True, kw_only=True):
    """B minus A; of a ratio its logarithm."""

    estimate: float
    error: float
    """Standard error."""
    df: float
    ratio: bool = False
    low: float
    high: float
    units: tuple[int, int]
    """How many of each side it is of."""
    points: int = 1

    def shown(self, value: float) -> str:
        """Return a bound or the estimate in words: a difference, or how much more in percent."""
        return f"{math.expm1(min(value, _MOST_RATIO)) * 100:+.3g} %" if self.ratio else f"{value:+.4g}"

    @property
    def text(self) -> str:
        """Return the estimate with its interval."""
        return f"{self.shown(self.estimate)} [{self.shown(self.low)}, {self.shown(self.high)}]"


class TooFew(Exception):
    """There is too little for an interval; the message says how little."""


def effect(a: Values, b: Values, *, ratio: bool = False, fewest: int = FEWEST_TRIALS) -> Effect:
    """Return the mean over the points of B's mean minus A's, with its interval.

    Args:
        a: One side.
        b: The other one; points that are not on both sides, or have one value there, do not count.
        ratio: Take the logarithms, which must be of positive values.
        fewest: Values that a side must have.

    Raises:
        TooFew: It cannot be said.
    """
    points = sorted(point for point in a.keys() & b.keys() if min(len(a[point]), len(b[point])) > 1)
    units = sum(len(a[one]) for one in points), sum(len(b[one]) for one in points)
    if min(units) < fewest:
        raise TooFew(f"too few: {units[0]} and {units[1]} values that compare, and {fewest} are needed")
    sides = [[[math.log(one) if ratio else one for one in side[point]] for point in points] for side in (a, b)]
    estimate = fmean(fmean(there) - fmean(here) for here, there in zip(*sides, strict=True))
    parts = [(variance(values) / len(values), len(values) - 1) for side in sides for values in side]
    total = sum(part for part, _ in parts)
    error = math.sqrt(total) / len(points)
    df = 1 / sum((part / total) ** 2 / free for part, free in parts) if total else math.inf
    half = student.quantile(1 - _TAIL, df) * error if total else 0.0
    return Effect(
        estimate=estimate, error=error, df=df, ratio=ratio, low=estimate - half, high=estimate + half, units=units,
        points=len(points),
    )  # fmt: skip


def bounds(margin: Margin, found: Effect, mean_a: float) -> tuple[float, float]:
    """Return the lowest and the highest effect that counts as none."""
    if not margin.relative:
        return -margin.value, margin.value
    if found.ratio:
        return math.log1p(-margin.value), math.log1p(margin.value)
    return -margin.value * abs(mean_a), margin.value * abs(mean_a)


def judged(found: Effect, within: tuple[float, float]) -> str:
    """Return `equivalent`, `different` or `inconclusive`."""
    low, high = within
    if low <= found.low and found.high <= high:
        return "equivalent"
    return "different" if found.low > high or found.high < low else "inconclusive"


def chance(found: Effect, within: tuple[float, float]) -> float:
    """Return how probable such an effect would be if the true one were at the margin: the p value of `different`."""
    beyond = max(found.estimate - within[1], within[0] - found.estimate)
    if not found.error:
        return float(beyond <= 0)
    return 1 - student.cdf(beyond / found.error, found.df)


def needed(found: Effect, within: tuple[float, float]) -> int:
    """Return how many times as many values would settle it nine times of ten, if there is no difference."""
    half = (found.high - found.low) / 2
    return math.ceil((2 * half / min(-within[0], within[1])) ** 2)


def holm(chances: Mapping[str, float]) -> dict[str, float]:
    """Return the p values of several tests, such that all of them together err as seldom as one."""
    adjusted: dict[str, float] = {}
    least = 0.0
    for at, name in enumerate(sorted(chances, key=lambda one: (chances[one], one))):
        least = max(least, min(1.0, (len(chances) - at) * chances[name]))
        adjusted[name] = least
    return adjusted


def shares(a: tuple[int, int], b: tuple[int, int]) -> Effect:
    """Return the difference of two shares, each given as (of these, of all), with its interval.

    Raises:
        TooFew: It cannot be said.
    """
    if min(a[1], b[1]) < FEWEST_TRIALS:
        raise TooFew(f"too few: {a[1]} and {b[1]} trials, and {FEWEST_TRIALS} are needed")
    (p, low_a, high_a), (q, low_b, high_b) = _wilson(*a), _wilson(*b)
    low = q - p - math.sqrt((q - low_b) ** 2 + (high_a - p) ** 2)
    high = q - p + math.sqrt((high_b - q) ** 2 + (p - low_a) ** 2)
    return Effect(estimate=q - p, error=(high - low) / (2 * _Z), df=math.inf, low=low, high=high, units=(a[1], b[1]))


def _wilson(of_these: int, of_all: int) -> tuple[float, float, float]:
    """Return a share with its interval."""
    p, z2 = of_these / of_all, _Z**2
    centre = (p + z2 / (2 * of_all)) / (1 + z2 / of_all)
    half = _Z * math.sqrt(p * (1 - p) / of_all + z2 / (4 * of_all**2)) / (1 + z2 / of_all)
    return p, centre - half, centre + half
