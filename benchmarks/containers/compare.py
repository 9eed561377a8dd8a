"""Side by side on one robot of the lab: three workloads in a container and natively, from the same files.

    python -m benchmarks.containers.compare
    python -m benchmarks.containers.compare --repeat 2 --items 50 --scratch

Needs root, for the lab. srprov builds the image and starts the container. Natively the same programs run from a copy
of the container's files (chroot), as processes of the robot: without the container's namespaces, cgroups, seccomp
filter and dropped capabilities. A repetition is a block: each workload both ways, in an order that a seed shuffles.
"""

from __future__ import annotations

import argparse
import datetime as dt
import itertools
import json
import os
import platform
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import yaml

from benchmarks.containers import table
from benchmarks.dispersion import boxes
from benchmarks.network.shell import Shell, opened
from benchmarks.provisioning import measure, robots
from benchmarks.provisioning.robots import SITE, Lab, Trouble
from srprov.lab import lab as labs

HERE = Path(__file__).parent
RESULTS = HERE / "results"
NAME = "srprov.bench-containers.work"
CDF = {
    "cdf": 1,
    "name": "work",
    "base": "debian:bookworm",
    "packages": {"apt": ["python3", "python3-pip"], "pip": ["opencv-python-headless==5.0.0.93", "numpy==2.4.6"]},
    "files": [{"src": "workload.py", "dest": "/opt/workload.py"}],
    "command": ["sleep", "infinity"],
}
FILES = "/var/lib/bench-native"
COPY = f"""
rm -rf {FILES} && mkdir {FILES} && docker export {NAME} | tar -x -C {FILES}
mount -t proc proc {FILES}/proc && mount --rbind /dev {FILES}/dev
"""
_CLEAN = "env -i PATH=/usr/local/bin:/usr/bin:/bin HOME=/root LC_ALL=C.UTF-8 OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1"
COMMANDS = {
    "native": f"chroot {FILES} {_CLEAN} python3 /opt/workload.py",
    "container": f"{_CLEAN} python3 /opt/workload.py",
}
_PATIENCE_S, _APPLY_S, _RUN_S, _CALM_S = 3600, 500, 200, 60


def main() -> None:
    """Measure, print a table, and write JSON and a plot."""
    wish = _arguments()
    with robots.lab(1, 0, _PATIENCE_S) as lab, tempfile.TemporaryDirectory(prefix="srprov-bench-") as name:
        _apply(lab, Path(name))
        with ExitStack() as stack:
            one = {**_about(lab), **blocks(_shells(lab, stack), wish)}
    print("\n" + table.table(table.rows(one["runs"])))
    if not wish.scratch:
        write(RESULTS, one)


def _apply(lab: Lab, folder: Path) -> None:
    """Bring the container up, and copy its files out of it."""
    shutil.copy(HERE / "workload.py", folder)
    (folder / "work.cdf").write_text(yaml.safe_dump(CDF))
    services = {"work": {"cdf": "work.cdf", "network": "none"}}
    (folder / "experiment.edf").write_text(yaml.safe_dump({"edf": 1, "name": "bench-containers", "services": services}))
    words = ("-m", "srprov", "apply", "experiment.edf", "-i", str(lab.inventory), "--yes", "--settle", "0")
    argv = (sys.executable, *words, "--runs", "runs")
    done = subprocess.run(argv, cwd=folder, capture_output=True, text=True, timeout=_APPLY_S, check=False)
    if done.returncode:
        raise Trouble(f"srprov apply: exit {done.returncode}: {done.stderr.strip()[-400:]}")
    lab.enter(lab.robots[0][0], COPY, limit_s=_APPLY_S)


def _shells(lab: Lab, stack: ExitStack) -> dict[str, Shell]:
    inside = {"native": ["sh"], "container": ["docker", "exec", "-i", NAME, "sh"]}
    robot = lab.robots[0][0]
    return {way: stack.enter_context(opened(labs.shell(SITE.name, robot, words))) for way, words in inside.items()}


def blocks(shells: Mapping[str, Shell], wish: argparse.Namespace) -> dict[str, Any]:
    """Run all blocks.

    Raises:
        Trouble: A run failed, or computed something else than the others of its workload.
    """
    source, begun, idle = random.Random(wish.seed), time.monotonic(), measure.calm(_CALM_S)
    runs: dict[str, dict[str, list[list[int]]]] = {name: {way: [] for way in shells} for name in table.ITEMS}
    digests: dict[str, str] = {}
    versions: dict[str, str] = {}
    for number in range(wish.repeat):
        order = list(itertools.product(runs, shells))
        source.shuffle(order)
        for name, way in order:
            count = min(wish.items, table.ITEMS[name])
            code, said = shells[way].run(f"{COMMANDS[way]} {name} {count}", _RUN_S)
            if code:
                raise Trouble(f"{name}, {way}: exit {code}: {said.strip()[-300:]}")
            found = json.loads(said)
            if digests.setdefault(name, found["digest"]) != found["digest"]:
                raise Trouble(f"{name}, {way}: something else was computed than before")
            versions = found["versions"]
            runs[name][way].append([round(1e6 * seconds) for seconds in found["seconds"]])
        print(f"block {number + 1} of {wish.repeat}, {time.monotonic() - begun:.0f} s", file=sys.stderr, flush=True)
    about = {"repeat": wish.repeat, "seed": wish.seed, "idle": round(idle, 3), "digests": digests, "versions": versions}
    return {**about, "seconds": round(time.monotonic() - begun), "runs": runs}


def _about(lab: Lab) -> dict[str, Any]:
    model = [line for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("model name")]
    return {
        "date": dt.datetime.now(dt.timezone.utc).date().isoformat(),
        "machine": platform.machine(),
        "processor": model[0].split(": ")[1] if model else "",
        "cpus": os.cpu_count(),
        "kernel": platform.release(),
        "docker": lab.enter(lab.robots[0][0], "docker version -f '{{.Server.Version}}'").strip(),
    }


def write(folder: Path, one: Mapping[str, Any]) -> None:
    """Write containers.json, and the box plots."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "containers.json").write_text(json.dumps(one, separators=(",", ":")) + "\n", encoding="utf-8")
    panels = {
        f"{name}, ms for {table.WORDS[name]}": {
            way: [us / 1000 for run in given for us in run] for way, given in ways.items()
        }
        for name, ways in one["runs"].items()
    }
    boxes(panels, folder / "containers.svg", columns=3)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeat", type=int, default=table.PAPER_RUNS, help="blocks")
    parser.add_argument("--items", type=int, default=10**6, help="of each run, at most")
    parser.add_argument("--seed", type=int, default=1, help="of the orders")
    parser.add_argument("--scratch", action="store_true", help="write no results")
    return parser.parse_args()


if __name__ == "__main__":
    main()
