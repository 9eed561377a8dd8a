"""Statistics of repeated measurements, as the paper has them, and their box plots. Pure, but for the plot's file."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

Values = Sequence[float | None]
"""One value for each repetition, None where it failed."""


@dataclass(frozen=True)
class Spread:
    """What the paper's tables have of a number of measurements."""

    count: int
    failed: int
    mean: float
    deviation: float
    """Of the sample."""

    @property
    def variation(self) -> float:
        """The coefficient of variation."""
        return self.deviation / self.mean


def spread(values: Values) -> Spread | None:
    """Return what there is to say of some measurements, or None when fewer than two succeeded."""
    good = [value for value in values if value is not None]
    if len(good) < 2:
        return None
    return Spread(len(good), len(values) - len(good), statistics.fmean(good), statistics.stdev(good))


def loss(base: Values, values: Values) -> tuple[float, float] | None:
    """Return how much less than the base it is in percent, and the half width of the 95 % interval of that.

    Repetitions are compared in pairs, since both were measured in the same block: what changed slowly cancels out. The
    loss is that of the means of all pairs; None with fewer than two pairs.
    """
    pairs = [(a, b) for a, b in zip(base, values, strict=True) if a is not None and b is not None]
    if len(pairs) < 2:
        return None
    mean = statistics.fmean(a for a, _ in pairs)
    differences = [(a - b) / mean for a, b in pairs]
    error = statistics.stdev(differences) / math.sqrt(len(pairs))
    return 100 * statistics.fmean(differences), 100 * quantile(len(pairs) - 1) * error


def quantile(freedom: int) -> float:
    """Return the 97.5 % quantile of Student's distribution; 1 % too small for 5 degrees of freedom, less for more."""
    z = statistics.NormalDist().inv_cdf(0.975)
    return z + (z**3 + z) / (4 * freedom) + (5 * z**5 + 16 * z**3 + 3 * z) / (96 * freedom**2)


def loss_of_means(base: Spread, other: Spread) -> tuple[float, float]:
    """Return the same for measurements of which only means and deviations are known."""
    error = math.hypot(base.deviation / math.sqrt(base.count), other.deviation / math.sqrt(other.count))
    return 100 * (1 - other.mean / base.mean), 100 * quantile(base.count + other.count - 2) * error / base.mean


def boxes(panels: Mapping[str, Mapping[str, Sequence[float]]], path: Path, columns: int = 4) -> None:
    """Draw box plots: a panel for each title, with a box for each name. Whiskers reach 1.5 times the box."""
    import matplotlib

    matplotlib.use("agg")
    matplotlib.rcParams["svg.hashsalt"] = "srprov"
    from matplotlib.figure import Figure

    lines = -(-len(panels) // columns)
    figure = Figure(figsize=(3.6 * min(columns, len(panels)), 3.4 * lines), layout="constrained")
    for axes, (title, given) in zip(figure.subplots(lines, columns, squeeze=False).flat, panels.items(), strict=False):
        axes.boxplot(list(given.values()), tick_labels=list(given), flierprops={"markersize": 2}, widths=0.6)
        axes.tick_params(axis="x", rotation=30, labelsize=7)
        axes.set_title(title, fontsize=9)
        axes.grid(True, axis="y", linewidth=0.3)
    figure.savefig(path, metadata={"Date": None})
