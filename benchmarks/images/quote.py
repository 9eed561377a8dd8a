"""What README.md and docs/images.md say of the costs of copies, made from the results; nobody types a figure.

    python -m benchmarks.images.quote     # writes both, between two marks

Takes `results/images.json`; a test holds both files to it. Before anything is measured they say nothing.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.images import demo, link, table
from benchmarks.images.compare import RESULTS
from benchmarks.provisioning.quote import replaced

ROOT = Path(__file__).parents[2]
BEGIN, END = "<!-- images: written by benchmarks/images/quote.py -->", "<!-- end of images -->"
HEADS = {
    "fresh": "no layer there",
    "nothing": "all there",
    "changed": "another top layer",
    "two": "two other top layers",
}
INTRODUCTION = """\
How long it takes until robots run a container of an image that another robot has, and the bytes between controller and
robots. The same machine: all engines share its two cores ([benchmarks/images/README.md](benchmarks/images/README.md)).

"""


def main() -> None:
    """Write both."""
    for name, part in parts(measured(RESULTS), measured(RESULTS, "demo")).items():
        file = ROOT / name
        file.write_text(replaced(file.read_text(encoding="utf-8"), part, BEGIN, END), encoding="utf-8")


def measured(results: Path, name: str = "images") -> list[dict[str, Any]]:
    """Return the medians that the comparison wrote, or `demo.py`; none before it was run."""
    file = results / f"{name}.json"
    return list(json.loads(file.read_text(encoding="utf-8"))["medians"]) if file.exists() else []


def parts(medians: Sequence[Mapping[str, Any]], of_demo: Sequence[Mapping[str, Any]] = ()) -> dict[str, str]:
    """Return file -> what stands between its marks: the README has most robots at full speed, docs/images.md all."""
    job = demo.table(of_demo) if of_demo else ""
    if not medians:
        return {"README.md": "", "docs/images.md": job}
    labs = list(dict.fromkeys((row["link"], row["image_mib"], row["robots"]) for row in medians))
    largest = max(labs, key=lambda lab: (lab[0] == link.FULL, lab[2], lab[1]))
    return {
        "README.md": INTRODUCTION + _tables(medians, [largest]),
        "docs/images.md": "\n".join(filter(None, [job, _tables(medians, labs)])),
    }


def _tables(medians: Sequence[Mapping[str, Any]], labs: Iterable[tuple[str, int, int]]) -> str:
    return "\n".join(_table([row for row in medians if _lab(row) == lab], *lab) for lab in labs)


def _lab(row: Mapping[str, Any]) -> tuple[str, int, int]:
    return row["link"], row["image_mib"], row["robots"]


def _table(rows: Sequence[Mapping[str, Any]], speed: str, image_mib: int, robots: int) -> str:
    """Return a table of one lab: a row for each tool, and seconds and bytes for each case."""
    cases = [case for case in table.CASES if any(row["case"] == case for row in rows)]
    shared = "the lab's full speed" if speed == link.FULL else f"{speed.removesuffix('mbit')} Mbit/s for all together"
    count = f"{robots} robot{'s' * (robots > 1)}"
    lines = [
        f"| {count}, {image_mib} MiB, {shared} | " + " | ".join(HEADS[case] for case in cases) + " |",
        "|---" * (len(cases) + 1) + "|",
    ]
    for tool in dict.fromkeys(row["tool"] for row in rows):
        found = {row["case"]: row for row in rows if row["tool"] == tool}
        lines.append("| " + " | ".join([tool.replace("|", "\\|"), *(_cell(found.get(case)) for case in cases)]) + " |")
    return "\n".join(lines) + "\n"


def _cell(row: Mapping[str, Any] | None) -> str:
    if row is None or row["seconds"] is None:
        return "-"
    return f"{row['seconds']:.1f} s, {(row['sent'] + row['received']) / table.MIB:.1f} MiB"


if __name__ == "__main__":
    main()
