"""How often `srprov compare` answers what: comparisons of sides that are drawn from the trials of one recorded run.

    python -m benchmarks.evidence.false_alarms RUN METRIC --margin 0.1

A/A: both sides are drawn from the same trials, with replacement, as many of each point as the run has, or --trials.
A/B: the same, and B's values are larger by twice the margin. Beside the rates stands what a normal distribution of the
run's scatter predicts, and how much scatter `srprov plan` says that such a design stands. No robot is needed.
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
from srprov.trials import power, student
from srprov.trials.power import CONFIDENCE

GRADES = ("equivalent", "inconclusive", "different")
_Z = NormalDist().inv_cdf(0.975)
Points = Mapping[str, Sequence[float]]


def main() -> None:
    """Draw, compare, and print a table in Markdown."""
    wish = _arguments()
    with read([wish.run]) as (run,):
        points = {point: list(trials.values()) for point, trials in run.values(wish.metric).items()}
    print(f"{wish.count} comparisons each, {_size(points, wish.trials, wish.margin)}\n")
    print("\n".join(table(points, wish.margin, wish.count, wish.seed, wish.trials)))


def table(points: Points, margin: float, count: int, seed: int, trials: int = 0) -> list[str]:
    """Return the lines of a table: how often which answer was given, with 95 % intervals, and what is predicted.

    Args:
        points: Point -> the values of its trials.
        margin: As a share.
        count: How many comparisons.
        seed: Of what is drawn.
        trials: Of each point and side; 0: as many as it has.
    """
    lines = ["| sides | " + " | ".join(GRADES) + " | predicted |", "|---" * (len(GRADES) + 2) + "|"]
    random_ = random.Random(seed)
    for name, by in (("A/A", 0.0), ("A/B", 2 * margin)):
        found = Counter(drawn(points, by, margin, random_, trials) for _ in range(count))
        cells = [rate(found[grade], count) for grade in GRADES]
        grade, effect_ = ("equivalent", 0.0) if by == 0 else ("different", by)
        told = f"{grade} {predicted(points, effect_, margin, trials) * 100:.0f} %"
        lines.append(f"| {name} | {' | '.join(cells)} | {told} |")
    return lines


def drawn(points: Points, by: float, margin: float, random_: random.Random, trials: int = 0) -> str:
    """Return the answer of one comparison."""
    a, b = (
        {name: random_.choices(values, k=trials or len(values)) for name, values in points.items()} for _side in "ab"
    )
    b = {name: [(1 + by) * one for one in values] for name, values in b.items()}
    found = effect(a, b, ratio=True)
    return judged(found, bounds(Margin(margin, relative=True), found, 0.0))


def predicted(points: Points, by: float, margin: float, trials: int = 0) -> float:
    """Return how probable the right answer is, by the run's scatter."""
    logs = [[math.log(one) for one in values] for values in points.values()]
    counts = [trials or len(values) for values in logs]
    parts = [(variance(values) / n, n - 1) for values, n in zip(logs, counts, strict=True) for _side in "ab"]
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


def _size(points: Points, trials: int, margin: float) -> str:
    scatter = fmean(math.sqrt(variance(map(math.log, values))) for values in points.values())
    counts = [trials] if trials else sorted({len(values) for values in points.values()})
    most = power.most_scatter(len(points), min(counts), Margin(margin, relative=True))
    design = f"{len(points)} points with {', '.join(map(str, counts))} trials a side, margin {margin * 100:g} %"
    stands = f"{100 * most:.1f} %" if most is not None else "nothing"
    return f"{design}; scatter {100 * scatter:.1f} %, and the design stands {stands}"


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", help="folder of a run, or a bundle")
    parser.add_argument("metric")
    parser.add_argument("--margin", type=float, default=0.1, help="as a share (default: 0.1)")
    parser.add_argument("--trials", type=int, default=0, help="of each point and side (default: all of the run's)")
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    return parser.parse_args()


if __name__ == "__main__":
    main()
