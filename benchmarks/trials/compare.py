"""Side by side on one lab: what a trial costs beside the time of its services, with srprov and with shell loops.

    python -m benchmarks.trials.compare
    python -m benchmarks.trials.compare --trials 20 --ways srprov,careful --scratch

Needs root, for the lab. A service that takes 1 s runs on each robot in each trial; its log comes home.
"""

from __future__ import annotations

import argparse
import datetime as dt
import json
import os
import platform
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.provisioning import measure, robots
from benchmarks.provisioning.compare import among
from benchmarks.trials.steps import overheads, summary, table
from benchmarks.trials.ways import SERVICE_S, Careful, Floor, Loop, OwnNetwork, Srprov, Way

RESULTS = Path(__file__).parent / "results"
FILE = RESULTS / "trials.json"
WAYS: dict[str, type[Way]] = {
    "srprov": Srprov, "careful": Careful, "loop": Loop, "floor": Floor, "network": OwnNetwork,
}  # fmt: skip
_PATIENCE_S = 3600
_CALM_S = 60


def main() -> None:
    """Measure what is asked for, print a table, and write JSON."""
    wish = _arguments()
    rows = list(json.loads(FILE.read_text(encoding="utf-8"))["rows"]) if wish.more and FILE.exists() else []
    with robots.lab(wish.robots, 0, _PATIENCE_S) as lab, tempfile.TemporaryDirectory(prefix="srprov-bench-") as name:
        for way in wish.ways:
            row = measured(WAYS[way](lab, Path(name, way)), wish.trials)
            rows = ordered([row, *(one for one in rows if one["tool"] != row["tool"])])
            if not wish.scratch:
                write(rows, wish.robots)
            lab.reset()  # what srprov has over all trials
    print("\n" + table(rows))


def ordered(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the rows in the order of the ways."""
    names = [way.name for way in WAYS.values()]
    return sorted(rows, key=lambda row: names.index(row["tool"]))


def write(rows: Sequence[dict[str, Any]], count: int) -> None:
    """Write what was measured so far on so many robots."""
    about = {"robots": count, "service_s": SERVICE_S, "cpus": os.cpu_count(), "kernel": platform.release()}
    about |= {"python": platform.python_version(), "date": dt.datetime.now(dt.timezone.utc).date().isoformat()}
    RESULTS.mkdir(exist_ok=True)
    FILE.write_text(json.dumps({"about": about, "rows": list(rows)}) + "\n", encoding="utf-8")


def measured(way: Way, count: int) -> dict[str, Any]:
    """Run the trials one way; the machine is let come to rest before."""
    idle = measure.calm(_CALM_S)
    count = max(1, count // way.one_of)
    found = overheads(way.run(count), SERVICE_S)
    row = {"tool": way.name, "trials": count, "idle": round(idle, 3), "load": os.getloadavg()[1]}
    print(f"{way.name}: {summary(found)['all']}, {idle:.0%} of the CPUs idle before it", file=sys.stderr, flush=True)
    steps = {name: {key: round(value, 4) for key, value in one.items()} for name, one in summary(found).items()}
    return {**row, "steps": steps, "each": [round(one["all"], 3) for one in found[:-1]]}


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=4)
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--ways", type=among(WAYS), default=list(WAYS), help=",".join(WAYS))
    parser.add_argument("--more", action="store_true", help="keep the results of ways that are not measured now")
    parser.add_argument("--scratch", action="store_true", help="write no results")
    return parser.parse_args()


if __name__ == "__main__":
    main()
