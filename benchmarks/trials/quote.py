"""What docs/trials.md says of the cost of a trial, made from the results; nobody types a figure.

    python -m benchmarks.trials.quote     # writes it, between two marks

Takes `results/trials.json`; a test holds the file to it. Before anything is measured it says so.
"""

from __future__ import annotations

import json
from pathlib import Path

from benchmarks.provisioning.quote import replaced
from benchmarks.trials.compare import RESULTS
from benchmarks.trials.steps import table

DOCS = Path(__file__).parents[2] / "docs" / "trials.md"
BEGIN, END = "<!-- cost: written by benchmarks/trials/quote.py -->", "<!-- end of cost -->"


def main() -> None:
    """Write it."""
    DOCS.write_text(replaced(DOCS.read_text(encoding="utf-8"), text(RESULTS), BEGIN, END), encoding="utf-8")


def text(results: Path) -> str:
    """Return the table and what it is of; or that nothing was measured."""
    file = results / "trials.json"
    if not file.exists():
        return "Not measured yet.\n"
    found = json.loads(file.read_text(encoding="utf-8"))
    about = found["about"]
    idle = min(row["idle"] for row in found["rows"])
    return (
        f"{about['robots']} robots, a service of {about['service_s']:g} s on each, {about['date']}; controller and all"
        f" engines share {about['cpus']} CPUs, of which at least {idle:.0%} were idle before each row.\n\n"
        f"{table(found['rows'])}"
    )


if __name__ == "__main__":
    main()
