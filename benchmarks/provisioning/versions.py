"""Another commit of srprov and this one, in pairs on the same lab: how much slower or faster has it become?

    python -m benchmarks.provisioning.versions COMMIT
    python -m benchmarks.provisioning.versions v0.1.0 --robots 12 --latency 0,40 --pairs 20 --options=--no-probe

Needs root, for the lab. Both run in this environment, so the other commit must be content with the packages that are
installed. In each pair the one that begins takes turns. Prints the median of the ratios of pairs, new to old, with an
interval of 95 % from 10,000 bootstrap samples of pairs.
"""

from __future__ import annotations

import argparse
import compileall
import json
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.provisioning import measure, robots, rounds, stats
from benchmarks.provisioning.compare import among, numbers
from benchmarks.provisioning.job import Job, make
from benchmarks.provisioning.tool import Call, Srprov

PROJECT = Path(__file__).parents[2]
SAMPLES = 10_000
LOCK_PATIENCE_S = 3600


class Version(Srprov):
    """`srprov apply --yes --settle 0` of one folder of sources."""

    def __init__(self, lab: robots.Lab, folder: Path, sources: Path, name: str, options: Sequence[str]) -> None:
        super().__init__(lab, folder)
        self.name = name
        self._sources = sources
        self._more = ("--settle", "0", *options)
        compileall.compile_dir(str(sources / "srprov"), quiet=1)

    def call(self, job: Job, variant: str) -> Call:
        """Run the sources' own package, whichever is installed."""
        installed = super().call(job, variant)
        argv = (sys.executable, "-m", "srprov", *installed.argv[1:], *self._more)
        return Call(argv, {**installed.env, "PYTHONPATH": str(self._sources)})


def main() -> None:
    """Measure, and print one line for each latency and scenario."""
    wish = _arguments()
    measure.adopt_orphans()
    measure.raise_limits()
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory(prefix="srprov-bench-versions-") as name:
        other = Path(name) / "other"
        subprocess.run(["git", "worktree", "add", "-q", "--detach", str(other), wish.commit], cwd=PROJECT, check=True)
        try:
            for latency in wish.latency:
                rows += pairs(Path(name), other, latency, wish)
        finally:
            subprocess.run(["git", "worktree", "remove", "--force", str(other)], cwd=PROJECT, check=True)
    found = ratios(rows)
    print("\n" + "\n".join(line(one) for one in found))
    if wish.out:
        wish.out.write_text(json.dumps({"old": wish.commit, "ratios": found, "runs": rows}, indent=1) + "\n")
    sys.exit(1 if any(row["problem"] for row in rows) else 0)


def pairs(folder: Path, other: Path, latency: int, wish: argparse.Namespace) -> list[dict[str, Any]]:
    """Measure all pairs on a lab of one latency."""
    rows: list[dict[str, Any]] = []
    with robots.lab(wish.robots, latency, LOCK_PATIENCE_S) as lab:
        job = make(lab.robots)
        old = Version(lab, folder / f"old-{latency}", other, "old", ())
        new = Version(lab, folder / f"new-{latency}", PROJECT, "new", shlex.split(wish.options))
        for pair in range(wish.pairs):
            for tool in (old, new) if pair % 2 else (new, old):
                rows += [{**row, "pair": pair} for row in rounds.play(lab, tool, job, wish.scenarios)]
    return rows


def ratios(rows: Sequence[Mapping[str, Any]], seed: int = 0) -> list[dict[str, Any]]:
    """Return one row per (latency, scenario): the median ratio of new to old over pairs, and its 95 % interval.

    A pair in which either has failed is left out.
    """
    random = np.random.default_rng(seed)
    seconds: dict[tuple[int, str], dict[int, dict[str, float]]] = {}
    for row in rows:
        if not row["problem"]:
            group = seconds.setdefault((row["latency_ms"], row["scenario"]), {})
            group.setdefault(row["pair"], {})[row["tool"]] = row["seconds"]
    found = []
    for (latency, scenario), group in sorted(seconds.items(), key=lambda g: (g[0][0], stats.SCENARIOS.index(g[0][1]))):
        both = [one for one in group.values() if len(one) == 2]
        if not both:
            continue
        quotients = np.array([one["new"] / one["old"] for one in both])
        samples = np.median(random.choice(quotients, (SAMPLES, len(quotients))), axis=1)
        low, high = np.quantile(samples, (0.025, 0.975))
        one: dict[str, Any] = {"latency_ms": latency, "scenario": scenario, "pairs": len(both)}
        one |= {"old": float(np.median([each["old"] for each in both]))}
        one |= {"new": float(np.median([each["new"] for each in both]))}
        one |= {"ratio": float(np.median(quotients)), "low": float(low), "high": float(high)}
        found.append(one)
    return found


def line(one: Mapping[str, Any]) -> str:
    """Return a line of the printed table."""
    return (
        f"{one['latency_ms']:3} ms  {one['scenario']:8} old {one['old']:.2f} s, new {one['new']:.2f} s:"
        f" {one['ratio']:.3f} [{one['low']:.3f}, {one['high']:.3f}], {one['pairs']} pairs"
    )


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("commit", help="of the old one; a tag or a branch will do")
    parser.add_argument("--robots", type=int, default=12)
    parser.add_argument("--latency", type=numbers, default=[0, 40], help="SSH round trips in ms, e.g. 0,40")
    parser.add_argument("--scenarios", type=among(stats.SCENARIOS), default=list(stats.SCENARIOS))
    parser.add_argument("--pairs", type=int, default=20)
    parser.add_argument("--options", default="", help="more options of the new one, e.g. --options=--no-probe")
    parser.add_argument("--out", type=Path, help="write all runs to this JSON file")
    return parser.parse_args()


if __name__ == "__main__":
    main()
