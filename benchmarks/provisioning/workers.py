"""What worker processes save: the same verbs on simulated robots, by one process and by `--workers 2`.

    python -m benchmarks.provisioning.workers [--robots 200,1000] [--workers 1,2] [--rate 40,1000] [--repeat 1]

Every robot is an SSH server on a loopback address with a robot in memory behind it (`simulated.py`); no lab is needed.
An experiment with a service on each robot, or on --services of them, is made, then nothing is to be done, then a
variable of every service is another. Each way begins with fresh servers. What `plan` prints and the report of each run
must be the same for all ways, but for times, bytes and ids. The servers run on the same processors as srprov, so the
CPU time of each process is what counts: it is read from /proc while the processes run.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from benchmarks.provisioning import measure, peers
from benchmarks.provisioning.compare import RESULTS
from benchmarks.provisioning.robots import ROOT, Trouble
from benchmarks.provisioning.tool import HERE

SERVERS = 4
PORT = 2222
READY_S = 240
LIMIT_S = 900
LOOK_S = 0.05
TICK = os.sysconf("SC_CLK_TCK")
VARYING = {
    "duration_s", "phases", "run", "connect_s", "asked_s", "acted_s", "bytes_sent", "bytes_received", "seconds",
}  # fmt: skip
"""Fields of a report that differ from run to run of one process, too."""
ACTS = ("apply new", "plan", "apply nothing", "plan changed", "apply changed")


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    numbers = lambda text: [int(word) for word in text.split(",")]  # noqa: E731 - one line says it
    parser.add_argument("--robots", type=numbers, default=[200, 1000])
    parser.add_argument("--workers", type=numbers, default=[1, 2])
    parser.add_argument("--rate", type=numbers, default=[40, 1000])
    parser.add_argument("--services", type=int, default=0, help="on as many of the robots; 0: on each")
    parser.add_argument("--repeat", type=int, default=1)
    parser.add_argument("--acts", type=lambda text: text.split(","), default=list(ACTS))
    parser.add_argument("--scratch", action="store_true", help="write no results")
    wish = parser.parse_args()
    measure.raise_limits()
    peers.environment("asyncssh", ["asyncssh>=2.20"])
    rows: list[dict[str, Any]] = []
    for robots in wish.robots:
        for rate in wish.rate:
            said: dict[str, str] = {}
            with tempfile.TemporaryDirectory(prefix="srprov-bench-") as name:
                for workers in wish.workers * wish.repeat:
                    folder = Path(name) / "fleet"  # a plan's hash covers where its EDF is: the same for all ways
                    folder.mkdir()
                    rows += _Fleet(folder, robots, wish.services or robots).measure(workers, rate, wish.acts, said)
                    shutil.rmtree(folder)
    text = table(rows)
    print(text)
    if not wish.scratch:
        (RESULTS / "workers.json").write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
        (RESULTS / "workers.md").write_text(text, encoding="utf-8")
    sys.exit(1 if any(row["problem"] for row in rows) else 0)


class _Fleet:
    """Simulated robots, an inventory and an experiment."""

    def __init__(self, folder: Path, robots: int, services: int) -> None:
        self.folder, self.robots, self.services = folder, robots, services
        key = str(folder / "client")
        subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", key], check=True)
        hosts = {
            name: {"ansible_host": address, "ansible_port": PORT} for name, address in map(_identity, range(robots))
        }
        known = f"-o UserKnownHostsFile={folder / 'known'}"
        common = {"ansible_user": "root", "ansible_ssh_private_key_file": key, "ansible_ssh_common_args": known}
        (folder / "inventory.yml").write_text(json.dumps({"all": {"hosts": hosts, "vars": common}}))

    def measure(self, workers: int, rate: int, acts: Sequence[str], said: dict[str, str]) -> list[dict[str, Any]]:
        """Do it once; `said` has what the first way said to each act, and gets its own if it is the first."""
        rows = []
        with self.servers():
            for act in ACTS:
                if act not in acts and act != "apply new":
                    continue
                self.write(2 if "changed" in act else 1)
                verb = act.partition(" ")[0]
                row = self.one(verb, workers, rate)
                now = row.pop("said")
                if (first := said.setdefault(act, now)) != now and not row["problem"]:
                    other = next(
                        (pair for pair in zip(first.split("\n"), now.split("\n"), strict=False) if pair[0] != pair[1]),
                        (),
                    )
                    row["problem"] = f"it says something else than the first way: {str(other)[:600]}"
                about = {"robots": self.robots, "services": self.services, "rate": rate, "workers": workers, "act": act}
                rows.append({**about, **row})
                print(
                    f"{self.robots:5} robots  {rate:5}/s  workers {workers}  {act:14} {row['seconds']:7.2f} s  cpu "
                    f"{' '.join(map(str, row['cpu']))} s  {row['rss_mib']} MiB  {row['problem']}", flush=True,
                )  # fmt: skip
        return rows

    def write(self, value: int) -> None:
        """Write the experiment, with a variable of all services."""
        about = {"image": "busybox", "network": "none", "command": ["sleep", "86400"]}
        services = {
            f"a{number:04}": {**about, "robot": _identity(number)[0], "environment": {"RATE": str(value)}}
            for number in range(self.services)
        }
        (self.folder / "experiment.edf").write_text(json.dumps({"edf": 1, "name": "many", "services": services}))

    def one(self, verb: str, workers: int, rate: int) -> dict[str, Any]:
        """Run one verb."""
        argv = [sys.executable, "-m", "srprov", verb, "experiment.edf", "-i", "inventory.yml", "--timeout", "120",
                "--workers", str(workers), "--connect-rate", str(rate), "--runs", "runs"]  # fmt: skip
        argv += ["--yes", "--settle", "0", "--json"] if verb == "apply" else []
        # servers on the same processors are silent for longer than robots are
        env = {**os.environ, "PYTHONPATH": str(ROOT), "SRPROV_HEARTBEAT": "5,120,180"}
        began = time.perf_counter()
        process = subprocess.Popen(argv, cwd=self.folder, env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        looking = _Looking(process.pid)
        try:
            out, err = process.communicate(timeout=LIMIT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            out, err = process.communicate()
        seconds = time.perf_counter() - began
        cpu, rss = looking.over()
        problem = f"exit {process.returncode}: {err.decode()[-300:]}" if process.returncode else ""
        if verb == "apply" and not problem:
            out = json.dumps(_lasting(json.loads(out)), sort_keys=True, indent=1).encode()
        said = out.replace(str(self.folder).encode(), b"").decode()
        return {"seconds": round(seconds, 2), "cpu": cpu, "rss_mib": rss, "problem": problem, "said": said}

    @contextlib.contextmanager
    def servers(self) -> Iterator[None]:
        """Serve all robots."""
        share = -(-self.robots // SERVERS)
        packages = next((peers.CACHE / "asyncssh" / "lib").glob("python*/site-packages"))
        env = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (ROOT, packages, HERE)))}
        with contextlib.ExitStack() as stack:
            log = stack.enter_context((self.folder / "servers.log").open("w+"))
            firsts = range(0, self.robots, share)
            for first in firsts:
                words = (str(self.folder), str(first), str(min(share, self.robots - first)))
                argv = [sys.executable, "-m", "benchmarks.provisioning.simulated", *words]
                server = subprocess.Popen(argv, env=env, stdin=subprocess.DEVNULL, stdout=log, stderr=log)
                stack.callback(lambda one: (one.kill(), one.wait()), server)
            deadline = time.monotonic() + READY_S
            while not all((self.folder / f"{first}.known").exists() for first in firsts):
                if time.monotonic() > deadline:
                    raise Trouble(f"the servers were not ready within {READY_S} s: {log.read()[-500:]}")
                time.sleep(0.1)
            with (self.folder / "known").open("w") as known:
                for first in firsts:
                    known.write((self.folder / f"{first}.known").read_text())
            yield
            log.seek(0)
            if text := log.read().strip():
                print(f"servers: {text[-600:]}", file=sys.stderr)
        shutil.rmtree(self.folder / "runs", ignore_errors=True)


class _Looking:
    """Looks at a process and its children while they run: CPU seconds and the most memory of each."""

    def __init__(self, pid: int) -> None:
        self._pid, self._over = pid, threading.Event()
        self._seen: dict[int, tuple[float, float]] = {}
        self._thread = threading.Thread(target=self._look_on, daemon=True)
        self._thread.start()

    def over(self) -> tuple[list[float], list[int]]:
        """Return both lists, the process itself first."""
        self._over.set()
        self._thread.join()
        pids = [self._pid, *sorted(self._seen.keys() - {self._pid})]
        # what lived for a moment only, such as ssh-keygen, is no worker
        kept = [pid for pid in pids if pid == self._pid or self._seen[pid][0] > 0.1]
        return [round(self._seen[pid][0], 2) for pid in kept], [round(self._seen[pid][1]) for pid in kept]

    def _look_on(self) -> None:
        while not self._over.wait(LOOK_S):
            with contextlib.suppress(OSError, IndexError, ValueError):
                listed = Path(f"/proc/{self._pid}/task/{self._pid}/children").read_text().split()
                for pid in (self._pid, *map(int, listed)):
                    self._look(pid)

    def _look(self, pid: int) -> None:
        with contextlib.suppress(OSError, IndexError, ValueError):
            fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
            status = Path(f"/proc/{pid}/status").read_text()
            peak = int(status.partition("VmHWM:")[2].split()[0]) / 1024
            self._seen[pid] = (int(fields[11]) + int(fields[12])) / TICK, peak


def _identity(number: int) -> tuple[str, str]:
    """Return name and address, as `simulated.identity` does in another environment."""
    return f"s{number:04}", f"127.2.{number // 200}.{1 + number % 200}"


def _lasting(value: object) -> object:
    """Leave out of a report what differs from run to run."""
    if isinstance(value, dict):
        return {key: _lasting(item) for key, item in value.items() if key not in VARYING}
    return [_lasting(item) for item in value] if isinstance(value, list) else value


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Return a Markdown table of medians."""
    lines = ["| robots | services | rate | act | workers | s | CPU s: itself, each worker | MiB | of one process |",
             "|---|---|---|---|---|---|---|---|---|"]  # fmt: skip
    groups: dict[tuple[int, int, int, str, int], list[dict[str, Any]]] = {}
    for row in rows:
        if not row["problem"]:
            groups.setdefault((row["robots"], row["services"], row["rate"], row["act"], row["workers"]), []).append(row)
    alone = {}
    for key, group in sorted(groups.items(), key=lambda one: (one[0][:3], ACTS.index(one[0][3]), one[0][4])):
        seconds = statistics.median(row["seconds"] for row in group)
        cpu = [statistics.median(values) for values in zip(*(row["cpu"] for row in group), strict=False)]
        rss = [max(values) for values in zip(*(row["rss_mib"] for row in group), strict=False)]
        if key[4] == 1:
            alone[key[:4]] = seconds, max(cpu)
        share = ""
        if key[:4] in alone:
            wall, most = alone[key[:4]]
            share = f"time {seconds / wall:.2f}, CPU {max(cpu) / most:.2f}"
        cells = (*key, f"{seconds:.1f}", ", ".join(f"{one:.1f}" for one in cpu), ", ".join(map(str, rss)), share)
        lines.append(f"| {' | '.join(map(str, cells))} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
