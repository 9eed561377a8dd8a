"""How often `srprov compare` answers what: comparisons of sides that are drawn from the trials of one recorded run.

    python -m benchmarks.evidence.false_alarms RUN METRIC --margin 0.1

A/A: both sides are drawn from the same trials, with replacement, as many of each point as the run has. A/B: the same,
and B's values are larger by twice the margin. Beside the rates stands what a normal distribution of the run's scatter
predicts. No robot is needed.
"""

from __future__ import annotations

import argparse
import math
import random
from collections import Counter
from collections.abc import Mapping, Sequence
from statistics import NormalDist, fmean, variance

from srprov.definitions.trialsmodel import Margin
from srprov.evidence.compare_runs import read
from srprov.evidence.effects import bounds, effect, judged
from srprov.trials import student
from srprov.trials.power import CONFIDENCE

GRADES = ("equivalent", "inconclusive", "different")
_Z = NormalDist().inv_cdf(0.975)
Points = Mapping[str, Sequence[float]]


def main() -> None:
    """Draw, compare, and print a table in Markdown."""
    wish = _arguments()
    with read([wish.run]) as (run,):
        points = {point: list(trials.values()) for point, trials in run.values(wish.metric).items()}
    print(f"{wish.count} comparisons each, {_size(points)}, margin {wish.margin * 100:g} %\n")
    print("\n".join(table(points, wish.margin, wish.count, wish.seed)))


def table(points: Points, margin: float, count: int, seed: int) -> list[str]:
    """Return the lines of a table: how often which answer was given, with 95 % intervals, and what is predicted."""
    lines = ["| sides | " + " | ".join(GRADES) + " | predicted |", "|---" * (len(GRADES) + 2) + "|"]
    random_ = random.Random(seed)
    for name, by in (("A/A", 0.0), ("A/B", 2 * margin)):
        found = Counter(drawn(points, by, margin, random_) for _ in range(count))
        cells = [rate(found[grade], count) for grade in GRADES]
        grade, power = ("equivalent", 0.0) if by == 0 else ("different", by)
        told = f"{grade} {predicted(points, power, margin) * 100:.0f} %"
        lines.append(f"| {name} | {' | '.join(cells)} | {told} |")
    return lines


def drawn(points: Points, by: float, margin: float, random_: random.Random) -> str:
    """Return the answer of one comparison."""
    a = {name: random_.choices(values, k=len(values)) for name, values in points.items()}
    b = {name: [(1 + by) * one for one in random_.choices(values, k=len(values))] for name, values in points.items()}
    found = effect(a, b, ratio=True)
    return judged(found, bounds(Margin(margin, relative=True), found, 0.0))


def predicted(points: Points, by: float, margin: float) -> float:
    """Return how probable the right answer is, by the run's scatter."""
    logs = [[math.log(one) for one in values] for values in points.values()]
    parts = [(variance(values) / len(values), len(values) - 1) for values in logs for _side in "ab"]
    total = sum(part for part, _ in parts)
    error = math.sqrt(total) / len(points)
    if not error:
        return 1.0
    half = student.quantile((1 + CONFIDENCE) / 2, total**2 / sum(part**2 / free for part, free in parts)) * error
    low, high = math.log1p(-margin), math.log1p(margin)
    of = NormalDist(math.log1p(by), error)
    if by:
        return 1 - of.cdf(high + half)
    return max(0.0, of.cdf(high - half) - of.cdf(low + half))


def rate(found: int, count: int) -> str:
    """Return a share in percent with Wilson's interval."""
    p, z2 = found / count, _Z**2
    centre = (p + z2 / (2 * count)) / (1 + z2 / count)
    half = _Z * math.sqrt(p * (1 - p) / count + z2 / (4 * count**2)) / (1 + z2 / count)
    return f"{100 * p:.0f} % [{100 * (centre - half):.0f}, {100 * (centre + half):.0f}]"


def _size(points: Points) -> str:
    scatter = fmean(math.sqrt(variance(map(math.log, values))) for values in points.values())
    counts = sorted({len(values) for values in points.values()})
    return f"{len(points)} points with {', '.join(map(str, counts))} trials a side, scatter {100 * scatter:.0f} %"


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", help="folder of a run, or a bundle")
    parser.add_argument("metric")
    parser.add_argument("--margin", type=float, default=0.1, help="as a share (default: 0.1)")
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    return parser.parse_args()


if __name__ == "__main__":
    main()
