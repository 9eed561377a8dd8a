"""Side by side in one run: srprov and other ways bring images to the same robots.

    python -m benchmarks.images.compare
    python -m benchmarks.images.compare --robots 3 --image-mib 120 --links 50mbit --tools thin,parallel --scratch

Needs root, for the lab, which has one robot more: the one that has the images.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import platform
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from benchmarks.images import link, rounds, shell, table, tool
from benchmarks.images.ansible import Ansible
from benchmarks.images.fleet import Fleet
from benchmarks.provisioning import measure, robots
from benchmarks.provisioning.compare import among, numbers

RESULTS = Path(__file__).parent / "results"
LOCK_PATIENCE_S = 3600
TOOLS: dict[str, type[tool.Tool]] = {
    "thin": tool.Thin,
    "registry": tool.Registry,
    "whole": tool.Whole,
    "loop": shell.Loop,
    "parallel": shell.Parallel,
    "packed": shell.Packed,
    "pull": shell.Pull,
    "ansible": Ansible,
}


def main() -> None:
    """Measure what is asked for, and write JSON and a table."""
    wish = _arguments()
    measure.adopt_orphans()
    measure.raise_limits()
    rows: list[dict[str, Any]] = []
    try:
        for row in measured(wish):
            rows.append(row)
    except KeyboardInterrupt:
        print("interrupted; writing what there is", file=sys.stderr)
    failed = any(row["problem"] for row in rows)
    if rows and wish.out and wish.more:
        rows = kept(wish.out / "images.json", rows) + rows
    found = table.medians(rows)
    print("\n" + table.table(found))
    if rows and wish.out:
        write(wish.out, rows, found)
    sys.exit(1 if failed else 0)


def measured(wish: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Measure all wanted tools on one lab."""
    classes = [TOOLS[name] for name in wish.tools]
    for each in classes:
        each.install_once()
    with tempfile.TemporaryDirectory(prefix="srprov-bench-images-") as name:
        folder, made = Path(name, "tool"), dict[str, int]()
        with robots.lab(max(wish.robots) + 1, 0, LOCK_PATIENCE_S) as lab:
            for count, word, each in itertools.product(wish.robots, wish.links, classes):
                fleet = Fleet(lab, lab.robots[1 : count + 1], wish.image_mib, made)
                yield from rounds.play(fleet, each(fleet, folder), word, wish.cases, wish.repeat)


def kept(file: Path, rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the runs of earlier results that were not measured again."""
    again = {tuple(row[name] for name in table.KEY) for row in rows}
    before = json.loads(file.read_text(encoding="utf-8"))["runs"] if file.exists() else []
    return [row for row in before if tuple(row[name] for name in table.KEY) not in again]


def write(folder: Path, rows: Sequence[dict[str, Any]], found: Sequence[dict[str, Any]]) -> None:
    """Write images.json and images.md."""
    folder.mkdir(parents=True, exist_ok=True)
    about: dict[str, Any] = {"cpus": os.cpu_count(), "python": platform.python_version(), "kernel": platform.release()}
    used = {row["tool"] for row in rows}
    about["versions"] = {key: each.version() for key, each in TOOLS.items() if each.name in used and each.version()}
    text = json.dumps({"about": about, "medians": list(found), "runs": list(rows)}, indent=1) + "\n"
    (folder / "images.json").write_text(text, encoding="utf-8")
    versions = ", ".join(about["versions"].values())
    head = f"{about['cpus']} CPUs for controller and robots together, Python {about['python']}. {versions}\n\n"
    (folder / "images.md").write_text(head + table.table(found), encoding="utf-8")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=numbers, default=[1, 4, 12], help="how many get the image, e.g. 4,12")
    parser.add_argument("--image-mib", type=int, default=480, help="size of the image before compression")
    parser.add_argument("--links", type=_links, default=[link.FULL], help="full, or a rate that all share: full,50mbit")
    parser.add_argument("--tools", type=among(TOOLS), default=list(TOOLS), help=",".join(TOOLS))
    parser.add_argument("--cases", type=among(table.CASES), default=list(table.CASES), help=",".join(table.CASES))
    parser.add_argument("--repeat", type=int, default=3, help="at most; a case that took 10 s in all is not repeated")
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder of the results")
    parser.add_argument("--more", action="store_true", help="keep the results of what is not measured now")
    parser.add_argument("--scratch", dest="out", action="store_const", const=None, help="write no results")
    return parser.parse_args()


def _links(text: str) -> list[str]:
    words = text.split(",")
    try:
        for word in words:
            link.rate(word)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    return words


if __name__ == "__main__":
    main()
