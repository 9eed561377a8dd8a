"""What docs/paper.md says of the network, made from the results; nobody types a figure.

    python -m benchmarks.network.quote     # writes it, between two marks

Takes `results/network.json`; a test holds the file to it. Before anything is measured it says so.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks.network import table
from benchmarks.network.link import LINKS
from benchmarks.provisioning.quote import replaced

RESULTS = Path(__file__).parent / "results"
DOCS = Path(__file__).parents[2] / "docs" / "paper.md"
BEGIN, END = "<!-- network: written by benchmarks/network/quote.py -->", "<!-- end of network -->"
ENOUGH = {"limited": table.PAPER_RUNS, "full": 40}
"""Link -> repetitions below which the figures are called those of a trial run."""


def main() -> None:
    """Write it."""
    DOCS.write_text(replaced(DOCS.read_text(encoding="utf-8"), text(RESULTS), BEGIN, END), encoding="utf-8")


def text(results: Path) -> str:
    """Return a table for each link and what it is of; or that nothing was measured."""
    file = results / "network.json"
    if not file.exists():
        return "Not measured yet.\n"
    found = json.loads(file.read_text(encoding="utf-8"))
    return "\n".join(_part(name, found[name]) for name in LINKS if name in found)


def _part(name: str, one: Mapping[str, Any]) -> str:
    link = LINKS[name]
    trial = "" if one["repeat"] >= ENOUGH[name] else "**A trial run of the program, no measurement.** "
    missing = "".join(f" Not measured: `{way}` ({why})." for way, why in one["missing"].items())
    mtus = ", ".join(f"{way} {mtu}" for way, mtu in one["mtus"].items())
    head = (
        f"{trial}Link: {link.words}. {one['repeat']} blocks, {one['date']}; robots and all programs share {one['cpus']}"
        f" CPUs, of which {one['idle']:.0%} were idle before. Linux {one['kernel']}, Docker {one['docker']},"
        f" {', '.join(one['programs'])}. MTU: {mtus}.{missing}\n"
    )
    found = table.rows(one["values"], one["mtus"], link)
    shown = table.table(found, beside=bool(link.rate_mbit))
    verdicts = [table.verdicts(found)] if link.rate_mbit else []
    picture = f"![Box plots](../benchmarks/network/results/network-{name}.svg)\n"
    return "\n".join([head, *verdicts, shown, picture])


if __name__ == "__main__":
    main()
