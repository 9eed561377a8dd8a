"""The job of `make demo` on its three robots, thin and whole in turns: seconds and bytes, fresh and after a change.

    python -m benchmarks.images.demo --repeat 5

`fresh`: the robot that builds has the images of the last repetition; the two others, and srprov's cache, have nothing.
`changed`: all robots run the job; one line of each of its Python files is new, so that its images have new top layers.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import statistics
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.images.fleet import CLEAN
from benchmarks.images.table import MIB
from benchmarks.provisioning import measure, robots

RESULTS = Path(__file__).parent / "results"
EXAMPLE = robots.ROOT / "examples/chatter-ros"
WAYS, CASES = ("thin", "whole"), ("fresh", "changed")
_LOCK_PATIENCE_S = 600
_PATIENCE_S = 600


def main() -> None:
    """Measure, and write `results/demo.json`."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeat", type=int, default=5, help="of each way and case")
    parser.add_argument("--scratch", action="store_true", help="write no results")
    wish = parser.parse_args()
    measure.adopt_orphans()
    rows = list(measured(wish.repeat))
    found = medians(rows)
    print("\n" + table(found), end="")
    if not wish.scratch:
        text = json.dumps({"cpus": os.cpu_count(), "medians": found, "runs": rows}, indent=1) + "\n"
        (RESULTS / "demo.json").write_text(text, encoding="utf-8")


def measured(repeat: int) -> Iterator[dict[str, Any]]:
    """Give a row for each run of srprov; both ways take turns, as a machine is not equally fast all the time."""
    with tempfile.TemporaryDirectory(prefix="srprov-bench-demo-") as name, robots.lab(3, 0, _LOCK_PATIENCE_S) as lab:
        folder = Path(name)
        shutil.copytree(EXAMPLE, folder / "job")
        lab.reset()
        _run(lab, folder, "thin", "first")  # the base is pulled, and packages are installed
        for number in range(repeat):
            for way in WAYS if number % 2 else WAYS[::-1]:
                lab.reset()
                for robot, _ in lab.robots[1:]:
                    lab.enter(robot, CLEAN)
                shutil.rmtree(folder / "cache", ignore_errors=True)
                for case in CASES:
                    if case == "changed":
                        _change(folder / "job", f"{way} {number}")
                    row = {"way": way, "case": case, "repetition": number, **_run(lab, folder, way, case)}
                    words = f"{row['seconds']:6.2f} s, copies {row['copies']:5.2f} s, {row['bytes'] / MIB:6.1f} MiB"
                    print(f"{way:6} {case:8} {words}", flush=True)
                    yield row


def _change(job: Path, word: str) -> None:
    for file in job.glob("*.py"):
        with file.open("a", encoding="utf-8") as written:
            written.write(f"# {word}\n")


def _run(lab: robots.Lab, folder: Path, way: str, case: str) -> dict[str, Any]:
    """Apply the job once."""
    where = (str(folder / "job/experiment.edf"), "-i", str(lab.inventory), "--runs", str(folder / "runs"))
    events = folder / "events"
    words = ("-m", "srprov", "apply", *where, "--yes", "--events", str(events), "--settle", "0", "--copy", way)
    own = {"XDG_STATE_HOME": str(folder / "state"), "XDG_CACHE_HOME": str(folder / "cache")}
    taken = measure.run((sys.executable, *words), cwd=folder, env=own, limit_s=_PATIENCE_S)
    if taken.failure:
        raise robots.Trouble(f"{way}, {case}: {taken.failure}")
    ends = [one for one in map(json.loads, events.read_text(encoding="utf-8").splitlines()) if one["event"] == "end"]
    builder = lab.robots[0][0]
    copies = [one["duration_s"] for one in ends if "/image:" in one["id"] and one["robot"] != builder]
    return {
        "seconds": round(taken.seconds, 3),
        "copies": round(max(copies, default=0.0), 3),
        "bytes": taken.sent + taken.received,
        "idle_before": taken.idle,
    }


def medians(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return a row for each way and case."""
    names = ("seconds", "copies", "bytes")
    return [
        {"way": way, "case": case, **{name: statistics.median(one[name] for one in those) for name in names}}
        for way in WAYS
        for case in CASES
        if (those := [one for one in rows if (one["way"], one["case"]) == (way, case)])
    ]


def table(found: Sequence[Mapping[str, Any]]) -> str:
    """Return the medians as docs/images.md has them."""
    of = {(row["way"], row["case"]): row for row in found}
    lines = ["| the job of `make demo` | thin | whole | thin / whole |", "|---|---|---|---|"]
    words = {"fresh": "two robots have no layer", "changed": "top layers changed"}
    for case in CASES:
        thin, whole = of["thin", case], of["whole", case]
        for name, what in (("seconds", "all of it"), ("copies", "the longest copy"), ("bytes", "bytes")):
            cells = [f"{row[name]:.1f} s" if name != "bytes" else f"{row[name] / MIB:.1f} MiB" for row in (thin, whole)]
            lines.append(f"| {words[case]}, {what} | {' | '.join(cells)} | {thin[name] / whole[name]:.2f} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
