"""How long srprov takes to say anything: `--help` and `validate`, as multiples of a bare `python -c pass`.

    python -m benchmarks.provisioning.startup [--repeat 20]

Needs no lab. The commands take turns.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
from pathlib import Path

from benchmarks.provisioning import measure
from benchmarks.provisioning.compare import RESULTS
from benchmarks.provisioning.job import edf, make
from benchmarks.provisioning.tool import BIN

SERVICES = 12


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeat", type=int, default=20)
    parser.add_argument("--scratch", action="store_true", help="write no results")
    wish = parser.parse_args()
    found = times(wish.repeat)
    text = table(found)
    print(text)
    if not wish.scratch:
        RESULTS.mkdir(exist_ok=True)
        (RESULTS / "startup.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
        (RESULTS / "startup.md").write_text(text, encoding="utf-8")


def times(repeat: int) -> dict[str, list[float]]:
    """Return the seconds of every run of every command; the first round, with cold files, does not count."""
    with tempfile.TemporaryDirectory(prefix="srprov-bench-") as name:
        folder = Path(name)
        experiment = folder / "experiment.edf"
        experiment.write_text(json.dumps(edf(make([(f"robot{n}", f"10.0.0.{n}") for n in range(1, SERVICES + 1)]))))
        srprov = str(BIN / "srprov")
        commands = {
            "python -c pass": (sys.executable, "-c", "pass"),
            "srprov --help": (srprov, "--help"),
            f"srprov validate, {SERVICES} services": (srprov, "validate", str(experiment)),
        }
        found: dict[str, list[float]] = {what: [] for what in commands}
        for repetition in range(repeat + 1):
            for what, argv in commands.items():
                taken = measure.run(argv, cwd=folder, limit_s=60, wait_calm=False)
                if taken.code:
                    sys.exit(f"{what}: {taken.failure}")
                if repetition:
                    found[what].append(round(taken.seconds, 5))
    return found


def table(found: dict[str, list[float]]) -> str:
    """Return a Markdown table of medians and multiples of the first command's."""
    bare = statistics.median(next(iter(found.values())))
    lines = ["| command | median ms | times python |", "|---|---|---|"]
    for what, seconds in found.items():
        median = statistics.median(seconds)
        lines.append(f"| `{what}` | {1000 * median:.1f} | {median / bare:.1f} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
