"""Scale on simulated robots: an inventory of 100, 300 and 1000, an experiment on twelve of them, nothing to do.

    python -m benchmarks.provisioning.thousand [--robots 100,300,1000] [--repeat 3]

Twelve robots of the lab run the experiment; the other robots are SSH servers on loopback addresses that answer as an
idle robot of the lab did, when the same commands were recorded a moment before (`fake_robots.py`). srprov asks all of
them for facts, and must find that there is nothing to do. The servers run on the same CPUs as srprov.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import yaml

from benchmarks.provisioning import measure, peers, robots, stats
from benchmarks.provisioning.compare import LOCK_PATIENCE_S, RESULTS
from benchmarks.provisioning.fake_names import identity
from benchmarks.provisioning.job import edf, make
from benchmarks.provisioning.robots import KEY, KNOWN_HOSTS, Lab, Trouble
from benchmarks.provisioning.tool import BIN, HERE

MEMBERS = 12
SPARE = 3
"""Idle robots: two keep a record of the placement for srprov, the third is as all others are."""
PORT = 2222
SERVERS = 4
READY_S = 120
VERBS = ("facts", "plan", "apply")


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=lambda text: [int(word) for word in text.split(",")], default=[100, 300, 1000])
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--scratch", action="store_true", help="write no results")
    wish = parser.parse_args()
    measure.raise_limits()
    peers.environment("asyncssh", ["asyncssh>=2.20"])
    with (
        tempfile.TemporaryDirectory(prefix="srprov-bench-") as name,
        robots.lab(MEMBERS + SPARE, 0, LOCK_PATIENCE_S) as lab,
    ):
        rows = Fleet(lab, Path(name)).measure(wish.robots, wish.repeat)
    text = table(rows)
    print(text)
    if not wish.scratch:
        RESULTS.mkdir(exist_ok=True)
        (RESULTS / "thousand.json").write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
        (RESULTS / "thousand.md").write_text(text, encoding="utf-8")
    sys.exit(1 if any(row["problem"] for row in rows) else 0)


class Fleet:
    """Twelve robots that run an experiment, three that are idle, and the doubles of one of those."""

    def __init__(self, lab: Lab, folder: Path) -> None:
        """Start the experiment and find out which robot is idle."""
        self.folder = folder
        self.known = folder / "known_hosts"
        self.known.write_text(KNOWN_HOSTS.read_text())
        shutil.copy(f"{KEY}.pub", folder / "client.pub")
        self.hosts = {name: {"ansible_host": address} for name, address in lab.robots}
        (folder / "experiment.edf").write_text(json.dumps(edf(make(lab.robots[:MEMBERS]))))
        taken = self.run("apply", "--settle", "0")
        if taken.code:
            raise Trouble(f"apply: {taken.failure}")
        files = lab.everywhere("docker ps -q; ls /var/lib/srprov 2>/dev/null; true")
        self.idle = next(robot for robot, text in files.items() if not text.strip())
        self.address = dict(lab.robots)[self.idle]

    def run(self, verb: str, *more: str) -> measure.Taken:
        """Run srprov on the inventory as it is now."""
        common = {
            "ansible_user": "root",
            "ansible_ssh_private_key_file": str(KEY),
            "ansible_ssh_common_args": f"-o UserKnownHostsFile={self.known}",
        }
        inventory = self.folder / "inventory.yml"
        inventory.write_text(yaml.safe_dump({"all": {"hosts": self.hosts, "vars": common}}))
        words: tuple[str, ...] = ("-i", str(inventory), "--timeout", "60", *more)
        if verb != "facts":
            words = (str(self.folder / "experiment.edf"), *words, "--runs", str(self.folder / "runs"))
        if verb == "apply":
            words += ("--yes",)
        return measure.run((str(BIN / "srprov"), verb, *words), cwd=self.folder, limit_s=500)

    def measure(self, sizes: Sequence[int], repeat: int) -> list[dict[str, Any]]:
        """Record the idle robot, then give a row per verb, size and repetition."""
        rows = []
        with self.recorded():
            for verb in VERBS:
                taken = self.run(verb)
                if taken.code:
                    raise Trouble(f"{verb}, while recording: {taken.failure}")
        self.hosts.pop(self.idle)
        for size in sizes:
            with self.doubles(size - len(self.hosts)):
                for repetition in range(repeat):
                    for verb in VERBS:
                        rows.append({**self.one(verb, size), "repetition": repetition})
        return rows

    def one(self, verb: str, size: int) -> dict[str, Any]:
        """Measure once."""
        taken = self.run(verb)
        problem = taken.failure
        if verb != "facts" and not problem and "Nothing to do" not in taken.out + taken.err:
            problem = f"not nothing to do: {(taken.out + taken.err)[-400:]}"
        row = {"robots": size, "verb": verb, "seconds": round(taken.seconds, 3), "cpu": round(taken.cpu, 3)}
        row |= {"rss_mib": round(taken.rss_mib, 1), "problem": problem}
        print(
            f"{size:5} robots  {verb:6} {taken.seconds:7.2f} s  cpu {taken.cpu:6.2f} s"
            f"  {taken.rss_mib:6.0f} MiB  {problem}",
            flush=True,
        )
        return row

    @contextlib.contextmanager
    def recorded(self) -> Iterator[None]:
        """Let the idle robot be reached through the recorder."""
        out = self.folder / "record.json"
        words = ("record", str(out), self.address, str(KEY), str(KNOWN_HOSTS), str(PORT))
        with _server(*words, log=self.folder / "record.log"):
            self._trust([Path(f"{out}.known")])
            self.hosts[self.idle] = {"ansible_host": "127.0.0.1", "ansible_port": PORT}
            yield

    @contextlib.contextmanager
    def doubles(self, count: int) -> Iterator[None]:
        """Serve so many simulated robots, and have them in the inventory."""
        real, trusted = dict(self.hosts), self.known.read_text()
        share = -(-count // SERVERS)
        with contextlib.ExitStack() as stack:
            for first in range(0, count, share):
                own = str(min(share, count - first))
                words = (str(self.folder / "record.json"), str(self.folder), str(first), own, str(PORT))
                log = self.folder / f"{first}.log"
                (self.folder / f"{first}.known").unlink(missing_ok=True)
                stack.enter_context(_server("replay", *words, self.idle, self.address, log=log))
            self._trust([self.folder / f"{first}.known" for first in range(0, count, share)])
            for number in range(count):
                name, address = identity(number, self.idle)
                self.hosts[name] = {"ansible_host": address, "ansible_port": PORT}
            yield
        self.hosts = real
        self.known.write_text(trusted)

    def _trust(self, files: Sequence[Path]) -> None:
        deadline = time.monotonic() + READY_S
        for file in files:
            while not file.exists():
                if time.monotonic() > deadline:
                    raise Trouble(f"the servers were not ready within {READY_S} s")
                time.sleep(0.1)
            with self.known.open("a") as known:
                known.write(file.read_text())


@contextlib.contextmanager
def _server(*words: str, log: Path) -> Iterator[None]:
    python = str(peers.CACHE / "asyncssh" / "bin" / "python")
    with log.open("w") as out:
        argv = [python, str(HERE / "fake_robots.py"), *words]
        process = subprocess.Popen(argv, stdin=subprocess.DEVNULL, stdout=out, stderr=out)
        try:
            yield
        finally:
            process.terminate()
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait(20)
    if text := log.read_text().strip():
        print(f"{words[0]}: {text[-600:]}", file=sys.stderr)


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Return a Markdown table of medians, and what a robot more costs."""
    lines = ["| verb | robots | median s | CPU s | peak MiB |", "|---|---|---|---|---|"]
    slopes = ["| verb | s per robot | CPU s per robot | KiB per robot |", "|---|---|---|---|"]
    for verb in VERBS:
        groups: dict[int, list[dict[str, Any]]] = {}
        for row in rows:
            if row["verb"] == verb and not row["problem"]:
                groups.setdefault(row["robots"], []).append(row)
        found = {
            size: [statistics.median(row[name] for row in group) for name in ("seconds", "cpu", "rss_mib")]
            for size, group in groups.items()
        }
        lines += [f"| {verb} | {size} | {s:.2f} | {c:.2f} | {m:.0f} |" for size, (s, c, m) in found.items()]
        if len(found) > 1:
            per = [stats.line([(size, values[index]) for size, values in found.items()])[1] for index in range(3)]
            slopes.append(f"| {verb} | {per[0]:.4f} | {per[1]:.4f} | {1024 * per[2]:.0f} |")
    return "\n".join([*lines, "", *slopes]) + "\n"


if __name__ == "__main__":
    main()
