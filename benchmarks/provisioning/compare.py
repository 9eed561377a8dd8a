"""Side by side in one run: the floor, srprov and other tools do the same job on the same lab.

    python -m benchmarks.provisioning.compare
    python -m benchmarks.provisioning.compare --robots 12 --tools floor,srprov --scenarios nothing --repeat 5 --scratch

Needs root, for the lab. Tools take turns within each repetition, and another one begins each time.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
import tempfile
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any

from benchmarks.provisioning import measure, plots, robots, rounds, stats
from benchmarks.provisioning.contestants import TOOLS
from benchmarks.provisioning.job import make

RESULTS = Path(__file__).parent / "results"
LOCK_PATIENCE_S = 3600


def main() -> None:
    """Measure what is asked for, and write JSON, a table and a plot."""
    wish = _arguments()
    measure.adopt_orphans()
    measure.raise_limits()
    rows: list[dict[str, Any]] = []
    try:
        for latency in wish.latency:
            for count in wish.robots:
                rows += measure_lab(count, latency, wish)
    except KeyboardInterrupt:
        print("interrupted; writing what there is", file=sys.stderr)
    failed = any(row["problem"] for row in rows)
    if rows and wish.out and wish.more:
        rows = kept(wish.out / "provisioning.json", rows) + rows
    found = stats.medians(rows)
    print("\n" + stats.table(found) + "\n" + stats.phases(rows))
    if rows and wish.out:
        write(wish.out, rows, found)
    sys.exit(1 if failed else 0)


def kept(file: Path, rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the runs of earlier results whose lab and latency were not measured again; a lab is measured whole."""
    again = {(row["robots"], row["latency_ms"]) for row in rows}
    before = json.loads(file.read_text(encoding="utf-8"))["runs"] if file.exists() else []
    return [row for row in before if (row["robots"], row["latency_ms"]) not in again]


def measure_lab(count: int, latency: int, wish: argparse.Namespace) -> list[dict[str, Any]]:
    """Measure all wanted tools on one lab."""
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory(prefix="srprov-bench-tools-") as name:
        classes = [TOOLS[tool] for tool in wish.tools]
        for each in classes:
            each.install_once()
        with robots.lab(count, latency, LOCK_PATIENCE_S) as lab:
            tools = [each(lab, Path(name) / str(index)) for index, each in enumerate(classes)]
            for tool in tools:
                tool.prepare_robots()
            job = make(lab.robots)
            for repetition in range(wish.repeat):
                first = repetition % len(tools)
                for tool in tools[first:] + tools[:first]:
                    rows += [{**row, "repetition": repetition} for row in rounds.play(lab, tool, job, wish.scenarios)]
    return rows


def write(
    folder: Path, rows: Sequence[dict[str, Any]], found: Sequence[dict[str, Any]], name: str = "provisioning"
) -> None:
    """Write NAME.json, NAME.md and NAME.svg."""
    folder.mkdir(parents=True, exist_ok=True)
    about: dict[str, Any] = {"cpus": os.cpu_count(), "python": platform.python_version(), "kernel": platform.release()}
    used = {row["tool"] for row in rows}
    about["versions"] = {key: each.version() for key, each in TOOLS.items() if each.name in used}
    text = json.dumps({"about": about, "medians": list(found), "runs": list(rows)}, indent=1) + "\n"
    (folder / f"{name}.json").write_text(text, encoding="utf-8")
    versions = ", ".join(f"{key} {version}" for key, version in about["versions"].items() if version)
    head = f"{about['cpus']} CPUs for controller and robots together, Python {about['python']}. {versions}\n\n"
    (folder / f"{name}.md").write_text(head + stats.table(found) + "\n" + stats.phases(rows), encoding="utf-8")
    plots.bars(found, folder / f"{name}.svg")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=numbers, default=[1, 4, 12, 25], help="how many, e.g. 4,12")
    parser.add_argument("--latency", type=numbers, default=[0, 40], help="SSH round trips in ms, e.g. 0,40")
    parser.add_argument("--tools", type=among(TOOLS), default=list(TOOLS), help=",".join(TOOLS))
    parser.add_argument("--scenarios", type=among(stats.SCENARIOS), default=list(stats.SCENARIOS))
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder of the results")
    parser.add_argument("--more", action="store_true", help="keep the results of labs that are not measured now")
    parser.add_argument("--scratch", dest="out", action="store_const", const=None, help="write no results")
    return parser.parse_args()


def numbers(text: str) -> list[int]:
    """Return the numbers of an option's value, `4,12`."""
    return [int(word) for word in text.split(",")]


def among(known: Collection[str]) -> Callable[[str], list[str]]:
    """Return what parses an option's value, words that are among the known ones."""

    def parse(text: str) -> list[str]:
        words = text.split(",")
        if unknown := [word for word in words if word not in known]:
            raise argparse.ArgumentTypeError(f"{', '.join(unknown)}: not among {', '.join(known)}")
        return words

    return parse


if __name__ == "__main__":
    main()
