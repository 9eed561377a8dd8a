"""What docs/paper.md says of assignment and run time, made from their results; nobody types a figure.

    python -m benchmarks.paper     # writes both parts, each between two marks

Takes the results of benchmarks.assignment.paper and benchmarks.provisioning.surface; a test holds the file to them.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from benchmarks.assignment import paper
from benchmarks.provisioning import surface
from benchmarks.provisioning.quote import replaced
from srprov.assignment.fairness import RECOMMENDED

DOCS = Path(__file__).parents[1] / "docs" / "paper.md"
NAMES = {"floor": "a script per robot", "srprov0": "srprov, `--settle 0`", "srprov": "srprov"}


def main() -> None:
    """Write them."""
    DOCS.write_text(written(DOCS.read_text(encoding="utf-8")), encoding="utf-8")


def written(text: str) -> str:
    """Return the page with both parts as the results have them."""
    parts = {
        "optimality": optimality(json.loads((paper.RESULTS / "paper.json").read_text(encoding="utf-8"))["balanced"]),
        "runtime": runtime(json.loads((surface.RESULTS / "surface.json").read_text(encoding="utf-8"))["medians"]),
    }
    for name, part in parts.items():
        begin, end = f"<!-- {name}: written by benchmarks/paper.py -->", f"<!-- end of {name} -->"
        text = replaced(text, part, begin, end)
    return text


def optimality(found: list[dict[str, Any]]) -> str:
    """Return a table with the paper, without fairness, and with the recommended one."""
    lines = [
        "| | deviation of costs | CV | workers used | Jain's index | above the least cost |",
        "|---|---|---|---|---|---|",
        f"| *the paper* | {paper.PAPER['deviation']} | {paper.PAPER['variation']} | {paper.PAPER['workers']} of 12 "
        f"| about {paper.PAPER['jain']} | |",
    ]
    for one in found:
        if one["fairness"] in (0, RECOMMENDED):
            costs = f"{one['deviation']:.4f} | {one['variation']:.4f}"
            shares = f"{one['workers']} of 12 | {one['jain']:.2f} | {100 * one['over_optimum']:.2f} %"
            lines.append(f"| fairness {one['fairness']:g} | {costs} | {shares} |")
    return "\n".join(lines) + "\n"


def runtime(found: list[dict[str, Any]]) -> str:
    """Return the planes that fit the seconds best."""
    lines = surface.slopes(found).splitlines()
    for tool, name in NAMES.items():
        lines = [line.replace(f"| {tool} |", f"| {name} |") for line in lines]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
