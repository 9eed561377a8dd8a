"""What the README says about speed, made from the results; nobody types a figure.

    python -m benchmarks.provisioning.quote     # writes it into README.md, between two marks

Takes the JSON files of `results/`; a test holds the README to them.
"""

from __future__ import annotations

import json
import statistics
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks.provisioning.compare import RESULTS

README = Path(__file__).parents[2] / "README.md"
BEGIN, END = "<!-- speed: written by benchmarks/provisioning/quote.py -->", "<!-- end of speed -->"
COLUMNS = ((12, 0, "fresh"), (12, 0, "nothing"), (12, 0, "changed"), (12, 40, "nothing"))
NAMES = {
    "floor": "a compiled shell script per robot, over paramiko",
    "srprov": "**srprov**, which watches new services for 2 s",
    "srprov --settle 0": "srprov, `--settle 0`",
    "pyinfra": "pyinfra",
    "Ansible": "Ansible",
    "Ansible+Mitogen": "Ansible with Mitogen",
    "Docker Swarm": "Docker Swarm, `stack deploy`",
}


def main() -> None:
    """Write the README's part."""
    README.write_text(replaced(README.read_text(encoding="utf-8"), text(RESULTS)), encoding="utf-8")


def replaced(readme: str, part: str, begin: str = BEGIN, end: str = END) -> str:
    """Return the README with another part between the marks.

    Raises:
        ValueError: A mark is missing.
    """
    before, rest = readme.split(begin)
    _, after = rest.split(end)
    return f"{before}{begin}\n\n{part}\n{end}{after}"


def text(results: Path) -> str:
    """Return the table and the sentences behind it."""
    found = {
        name: json.loads((results / f"{name}.json").read_text()) for name in ("provisioning", "hundred", "thousand")
    }
    start = json.loads((results / "startup.json").read_text())
    return "\n".join([_table(found["provisioning"]), _scale(found["hundred"], found["thousand"]), _start(start)])


def _table(provisioning: Mapping[str, Any]) -> str:
    rows = {(r["robots"], r["latency_ms"], r["scenario"], r["tool"]): r for r in provisioning["medians"]}
    lines = [
        "| 12 robots | fresh | nothing to do | one service changed | nothing to do, 40 ms to each robot |",
        "|---|---|---|---|---|",
    ]
    for tool, name in NAMES.items():
        lines.append("| " + " | ".join([name, *(_cell(rows.get((*column, tool))) for column in COLUMNS)]) + " |")
    return "\n".join(lines) + "\n"


def _cell(row: Mapping[str, Any] | None) -> str:
    if row is None or row["seconds"] is None:
        return "-"
    return f"{row['seconds']:.2f} s" + (f" ({row['ratio']:.2f})" if row["ratio"] and row["tool"] != "floor" else "")


def _scale(hundred: Mapping[str, Any], thousand: list[Mapping[str, Any]]) -> str:
    one = next(r for r in hundred["medians"] if r["scenario"] == "nothing" and r["tool"] == "srprov --settle 0")
    lines = [
        f"A hundred robots of the lab, nothing to do, `--settle 0`: {one['seconds']:.1f} s, and"
        f" {one['rss_mib']:.0f} MiB of memory.",
        "Nothing to do on twelve robots, the others of the inventory simulated by SSH servers that answer as robots:",
        "",
        "| robots | `apply` | per robot | peak memory |",
        "|---|---|---|---|",
    ]
    for size in sorted({row["robots"] for row in thousand}):
        runs = [row for row in thousand if row["robots"] == size and row["verb"] == "apply"]
        seconds, rss = (statistics.median(row[key] for row in runs) for key in ("seconds", "rss_mib"))
        lines.append(f"| {size} | {seconds:.1f} s | {seconds / size * 1000:.0f} ms | {rss:.0f} MiB |")
    return "\n".join(lines) + "\n"


def _start(start: Mapping[str, list[float]]) -> str:
    middle = {what: statistics.median(times) for what, times in start.items()}
    bare = middle["python -c pass"]
    said = [
        f"`{what.split(',')[0]}` {seconds:.2f} s ({seconds / bare:.1f})"
        for what, seconds in middle.items()
        if what.startswith("srprov")
    ]
    return f"{' and '.join(said)}, in brackets as multiples of a bare `python -c pass`.\n"


if __name__ == "__main__":
    main()
