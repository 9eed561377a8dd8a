"""The dispersion table of the workloads, beside the paper's. Pure."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.dispersion import loss, spread

Runs = Mapping[str, Mapping[str, Sequence[Sequence[int]]]]
"""Workload -> way -> runs, each with the microseconds of its items."""
ITEMS = {"cpu": 300, "memory": 300, "vision": 881}
"""Items of a run; the paper's data set has 881 frames."""
WORDS = {"cpu": "an item", "memory": "an item", "vision": "a frame"}
PAPER_RUNS = 10
PAPER = {
    "x64": ("0.0908", "0.2800"),
    "x64_Cont": ("0.0908", "0.2800"),
    "ARM": ("1.2258", "0.2429"),
    "ARM_Cont": ("1.1820", "0.2426"),
}
"""Name -> deviation in seconds and CV of a frame of SLAMBench, as the paper gives them."""


def rows(runs: Runs) -> list[dict[str, Any]]:
    """Return a row for each workload and way: over all items, and how much longer the container takes than native.

    That is of the runs' means, both ways of a block as a pair, in percent with the half width of its 95 % interval.
    """
    found = []
    for name, ways in runs.items():
        means = {way: [statistics.fmean(run) for run in given] for way, given in ways.items()}
        lost = loss(means["native"], means["container"])
        for way, given in ways.items():
            items = [us / 1000 for run in given for us in run]
            one = spread(items)
            if one is None:
                continue
            row = {"workload": name, "way": way, "runs": len(given), "items": one.count, "mean": one.mean}
            row |= {"median": statistics.median(items), "deviation": one.deviation, "variation": one.variation}
            found.append({**row, "longer": (-lost[0], lost[1]) if lost and way != "native" else None})
    return found


def table(found: Sequence[Mapping[str, Any]]) -> str:
    """Return a Markdown table, the paper's rows below ours."""
    lines = [
        "| | median | mean | deviation | CV | items | longer than native, % (95 %) |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in found:
        longer = "" if row["longer"] is None else f"{row['longer'][0]:+.2f} ± {row['longer'][1]:.2f}"
        figures = " | ".join(f"{row[name]:.2f} ms" for name in ("median", "mean", "deviation"))
        items = f"{row['runs']} x {row['items'] // row['runs']}"
        lines.append(f"| {row['workload']}, {row['way']} | {figures} | {row['variation']:.4f} | {items} | {longer} |")
    for name, (deviation, variation) in PAPER.items():
        mean = 1000 * float(deviation) / float(variation)
        figures = f"| {mean:.0f} ms | {1000 * float(deviation):.1f} ms | {variation} | {PAPER_RUNS} x 881 |"
        lines.append(f"| *SLAMBench, the paper, {name}* | {figures} |")
    return "\n".join(lines) + "\n"
