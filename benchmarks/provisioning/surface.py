"""The run-time figure: 1..12 robots by 1..12 services, from the start of the command to containers that run.

    python -m benchmarks.provisioning.surface [--step 1] [--repeat 1] [--tools floor,srprov0]

Robots are clean before each run. Services are spread evenly (`slots_per_robot`). The floor is one script per robot,
whose containers start side by side. Slopes are those of the plane that fits best (least squares).
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from benchmarks.provisioning import measure, plots, robots, stats
from benchmarks.provisioning.compare import LOCK_PATIENCE_S, RESULTS
from benchmarks.provisioning.job import (
    BRIDGE,
    COMMAND,
    IMAGE,
    MTU,
    NETWORK,
    SUBNET,
    Job,
    Member,
    link_script,
    make,
    words,
)
from benchmarks.provisioning.robots import KEY, KNOWN_HOSTS, Lab, Trouble
from benchmarks.provisioning.tool import BIN, HERE

MOST = 12
TOOLS = ("floor", "srprov", "srprov0")


def main() -> None:
    """Measure the grid, and write JSON, slopes and a plot."""
    wish = _arguments()
    measure.adopt_orphans()
    points = sorted({1, MOST, *range(1, MOST + 1, wish.step)})
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory(prefix="srprov-bench-") as name, robots.lab(MOST, 0, LOCK_PATIENCE_S) as lab:
        for repetition in range(wish.repeat):
            for count in points:
                for services in points:
                    for tool in wish.tools:
                        row = one(lab, Path(name), tool, count, services)
                        rows.append({**row, "repetition": repetition})
    found = medians(rows)
    text = slopes(found)
    print(text)
    if not wish.scratch:
        RESULTS.mkdir(exist_ok=True)
        (RESULTS / "surface.json").write_text(json.dumps({"medians": found, "runs": rows}, indent=1) + "\n")
        (RESULTS / "surface.md").write_text(text, encoding="utf-8")
        plots.surfaces(found, RESULTS / "surface.svg")
    sys.exit(1 if any(row["problem"] for row in rows) else 0)


def one(lab: Lab, folder: Path, tool: str, count: int, services: int) -> dict[str, Any]:
    """Do it once on clean robots."""
    lab.reset()
    chosen = lab.robots[:count]
    argv = _floor(folder, chosen, services) if tool == "floor" else _srprov(lab, folder, chosen, services, tool)
    taken = measure.run(argv, cwd=folder, limit_s=300)
    problem = taken.failure
    seen = lab.look()
    running = sum(len(found["containers"]) for found in seen.values())
    if not problem and running != services:
        problem = f"{running} containers run, not {services}"
    print(f"{count:3} robots {services:3} services  {tool:8} {taken.seconds:6.2f} s  {problem}", flush=True)
    row = {"robots": count, "services": services, "tool": tool, "seconds": round(taken.seconds, 4)}
    return {**row, "idle_before": taken.idle, "problem": problem}


def _srprov(lab: Lab, folder: Path, chosen: Sequence[tuple[str, str]], services: int, tool: str) -> Sequence[str]:
    inventory = yaml.safe_load(lab.inventory.read_text(encoding="utf-8"))
    names = [name for name, _ in chosen]
    inventory["all"]["hosts"] = {name: inventory["all"]["hosts"][name] for name in names}
    (folder / "inventory.yml").write_text(yaml.safe_dump(inventory))
    each = {"image": IMAGE, "command": list(COMMAND)}
    experiment = {
        "edf": 1,
        "name": "surface",
        "services": {f"svc{index:02}": each for index in range(1, services + 1)},
        "placement": {"slots_per_robot": -(-services // len(chosen))},
    }
    (folder / "experiment.edf").write_text(json.dumps(experiment))
    settle = ("--settle", "0") if tool == "srprov0" else ()
    files = (str(folder / "experiment.edf"), "-i", str(folder / "inventory.yml"), "--runs", str(folder / "runs"))
    return (str(BIN / "srprov"), "apply", *files, "--yes", *settle)


def _floor(folder: Path, chosen: Sequence[tuple[str, str]], services: int) -> Sequence[str]:
    job = make(chosen[:services])
    plan: dict[str, Any] = {"key": str(KEY), "known_hosts": str(KNOWN_HOSTS), "robots": {}}
    for index, member in enumerate(job.members):
        mine = range(index, services, len(job.members))
        script = _script(job, member, mine)
        plan["robots"][member.robot] = {"address": member.underlay, "user": "root", "script": script}
    (folder / "plan.json").write_text(json.dumps(plan))
    return (sys.executable, str(HERE / "floor.py"), "up", str(folder / "plan.json"))


def _script(job: Job, member: Member, mine: Sequence[int]) -> str:
    """Return the lines that start a robot's services on clean ground."""
    starts = [
        f"docker run -d --name bench{index} --network {NETWORK} --ip 10.99.8.{10 + index} {IMAGE} {words()} >&2 &"
        for index in mine
    ]
    return f"""{link_script(job, member)}
set -e
docker network create --driver bridge --subnet {SUBNET} --gateway {member.gateway} \\
  -o com.docker.network.bridge.name={BRIDGE} -o com.docker.network.driver.mtu={MTU} {NETWORK} >/dev/null
vxlan_make
{chr(10).join(starts)}
wait
"""


def medians(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return one row per tool and point of the grid; failed runs are left out."""
    groups: dict[tuple[str, int, int], list[float]] = {}
    for row in rows:
        if not row["problem"]:
            groups.setdefault((row["tool"], row["robots"], row["services"]), []).append(row["seconds"])
    return [
        {"tool": tool, "robots": count, "services": services, "seconds": statistics.median(seconds)}
        for (tool, count, services), seconds in sorted(groups.items())
    ]


def slopes(found: Sequence[dict[str, Any]]) -> str:
    """Return a Markdown table of the planes."""
    lines = ["| tool | start s | per robot s | per service s | 1 x 1 s | 12 x 12 s |", "|---|---|---|---|---|---|"]
    for tool in dict.fromkeys(row["tool"] for row in found):
        mine = {(row["robots"], row["services"]): row["seconds"] for row in found if row["tool"] == tool}
        try:
            start, per_robot, per_service = stats.plane([(x, y, z) for (x, y), z in mine.items()])
        except ValueError as error:
            raise Trouble(f"{tool}: too few points: {error}") from None
        ends = " | ".join(f"{mine[corner]:.2f}" if corner in mine else "-" for corner in ((1, 1), (MOST, MOST)))
        lines.append(f"| {tool} | {start:.3f} | {per_robot:.4f} | {per_service:.4f} | {ends} |")
    return "\n".join(lines) + "\n"


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--step", type=int, default=1, help="of the grid; 1 and 12 are always in it")
    parser.add_argument("--repeat", type=int, default=1)
    parser.add_argument(
        "--tools", type=lambda text: text.split(","), default=["floor", "srprov0"], help=",".join(TOOLS)
    )
    parser.add_argument("--scratch", action="store_true", help="write no results")
    wish = parser.parse_args()
    if unknown := set(wish.tools) - set(TOOLS):
        parser.error(f"unknown: {', '.join(sorted(unknown))}")
    return wish


if __name__ == "__main__":
    main()
