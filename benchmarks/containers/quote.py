"""What docs/paper.md says of containers, made from the results; nobody types a figure.

    python -m benchmarks.containers.quote     # writes it, between two marks

Takes `results/containers.json`; a test holds the file to it. Before anything is measured it says so.
"""

from __future__ import annotations

import json
from pathlib import Path

from benchmarks.containers import table
from benchmarks.provisioning.quote import replaced

RESULTS = Path(__file__).parent / "results"
DOCS = Path(__file__).parents[2] / "docs" / "paper.md"
BEGIN, END = "<!-- containers: written by benchmarks/containers/quote.py -->", "<!-- end of containers -->"


def main() -> None:
    """Write it."""
    DOCS.write_text(replaced(DOCS.read_text(encoding="utf-8"), text(RESULTS), BEGIN, END), encoding="utf-8")


def text(results: Path) -> str:
    """Return the table and what it is of; or that nothing was measured."""
    file = results / "containers.json"
    if not file.exists():
        return "Not measured yet.\n"
    one = json.loads(file.read_text(encoding="utf-8"))
    whole = one["repeat"] >= table.PAPER_RUNS and all(
        len(run) == table.ITEMS[name] for name, ways in one["runs"].items() for given in ways.values() for run in given
    )
    trial = "" if whole else "**A trial run of the program, no measurement.** "
    versions = ", ".join(f"{name} {version}" for name, version in one["versions"].items())
    return (
        f"{trial}{one['machine']}, {one['processor']}, {one['cpus']} CPUs, of which {one['idle']:.0%} were idle before;"
        f" {one['date']}. Linux {one['kernel']}, Docker {one['docker']}, {versions}.\n\n"
        f"{table.table(table.rows(one['runs']))}\n"
        "![Box plots](../benchmarks/containers/results/containers.svg)\n"
    )


if __name__ == "__main__":
    main()
