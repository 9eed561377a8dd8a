"""Ways to run trials: each runs a number of them on the lab's robots, and says when each step of each ended."""

from __future__ import annotations

import http.client
import json
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import yaml

from benchmarks.provisioning.robots import KEY, KNOWN_HOSTS, Lab, Trouble
from benchmarks.trials.steps import Moments
from srprov.lab import state

SERVICE_S = 1.0
COMMAND = ("sh", "-c", "echo begun; sleep 1; echo done")
SSH = f"ssh -i {KEY} -o UserKnownHostsFile={KNOWN_HOSTS} -o StrictHostKeyChecking=yes -o BatchMode=yes"
MOMENTS = {"created": "create", "started": "start", "until": "wait", "stopped": "stop", "collected": "collect"}
"""Event of srprov's journal -> the step that ends then."""
_LONGEST_S = 60
"""For one trial."""


class Way:
    """A contestant. `name` is what tables say."""

    name = ""
    one_of = 1
    """It runs one of so many trials, where each takes long."""

    def __init__(self, lab: Lab, folder: Path) -> None:
        self.lab = lab
        self.folder = folder
        folder.mkdir(parents=True)

    def run(self, count: int) -> list[Moments]:
        """Run so many trials.

        Raises:
            Trouble: One of them did not do what it should.
        """
        raise NotImplementedError

    def _call(self, count: int, *argv: str) -> None:
        done = subprocess.run(
            argv, cwd=self.folder, capture_output=True, text=True, timeout=60 + count * _LONGEST_S, check=False
        )
        if done.returncode:
            raise Trouble(f"{self.name}: exit {done.returncode}: {(done.stdout + done.stderr)[-400:]}")

    def _check_logs(self, files: Iterable[Path], count: int) -> None:
        """Raise Trouble unless each robot's log of each trial came home whole."""
        logs = [file.read_text() for file in files]
        if len(logs) != count * len(self.lab.robots) or not all("begun" in log and "done" in log for log in logs):
            raise Trouble(f"{self.name}: {len(logs)} logs came of {count} trials, or not all are whole")


class Srprov(Way):
    """`srprov run --yes`, as users have it; moments are those of its journal."""

    name = "**`srprov run`**"

    def run(self, count: int) -> list[Moments]:
        """Run them in one run; what is there over all trials is made before the first."""
        service = {"image": "busybox", "command": list(COMMAND)}
        given: dict[str, Any] = {
            "edf": 1,
            "name": "bench",
            "trials": {"repetitions": count, "seed": 1, "timeout": "30s"},
        }
        given["services"] = {f"on-{name}": {**service, "robot": name} for name, _ in self.lab.robots}
        (self.folder / "bench.edf").write_text(yaml.safe_dump(given))
        words = ("run", "bench.edf", "-i", str(self.lab.inventory), "-o", "run", "--yes", "-q")
        self._call(count, sys.executable, "-m", "srprov", *words)
        lines = (self.folder / "run" / "journal.jsonl").read_text().splitlines()
        self._check_logs(self.folder.glob("run/trials/*/logs/*.log"), count)
        return trials_of([json.loads(line) for line in lines])


def trials_of(events: list[dict[str, Any]]) -> list[Moments]:
    """Return the moments of the trials in a journal."""
    found: list[dict[str, float]] = []
    for event in events:
        name, when = event["event"], event["monotonic"]
        if name == "begin":
            found.append({"begin": when})
        elif name == "end":
            found[-1]["remove"] = when
            if event["row"]["status"] != "ok":
                raise Trouble(f"a trial is {event['row']['status']}: {event['row']['reason']}")
        elif name in MOMENTS:
            found[-1][MOMENTS[name]] = when
    return found


class Shell(Way):
    """A bash script on the controller; it says when each step ended."""

    script = ""
    options = ""

    def run(self, count: int) -> list[Moments]:
        """Run them one after the other, with a folder for each."""
        robots = " ".join(f"root@{address}" for _, address in self.lab.robots)
        service = " ".join([COMMAND[0], COMMAND[1], f"'{COMMAND[2]}'"])
        ssh = f"{SSH} {self.options.format(folder=self.folder)}"
        head = HEAD.format(robots=robots, ssh=ssh, service=f'"{service}"', count=count)
        (self.folder / "script.sh").write_text(head + self.script)
        self._call(count, "bash", "script.sh")
        found: list[dict[str, float]] = []
        for line in (self.folder / "moments").read_text().splitlines():
            step, when = line.split()
            if step == "begin":
                found.append({})
            found[-1][step] = float(when)
        self._check_logs(self.folder.glob("out/*/*.log"), count)
        return list(found)


HEAD = """\
set -eo pipefail
robots="{robots}" service={service}
on() {{ local who=$1; shift; {ssh} "$who" "$@"; }}
leave() {{ {ssh} -O exit "$1" 2>/dev/null; }}
mark() {{ echo "$1 $EPOCHREALTIME" >>moments; }}
each() {{ # run a function for all robots at once
  local pids= pid robot
  for robot in $robots; do "$1" "$robot" & pids="$pids $!"; done
  for pid in $pids; do wait "$pid"; done
}}
for trial in $(seq {count}); do
mkdir -p out/$trial
mark begin
"""


class Loop(Shell):
    """One robot after the other, a connection for each command: what one types."""

    name = "a shell loop, as one types it"
    one_of = 5
    script = """\
for r in $robots; do on $r docker run -d --name bench -e TRIAL=$trial busybox "$service" >/dev/null; done
mark start
for r in $robots; do on $r docker wait bench >/dev/null; done
mark wait
for r in $robots; do
  on $r docker logs -t bench >out/$trial/$r.log 2>&1
  on $r docker inspect bench >out/$trial/$r.json
done
mark collect
for r in $robots; do on $r docker rm -v bench >/dev/null; done
mark remove
done
"""


class Careful(Shell):
    """All robots at once, over one connection for each that stays open, created before any is started."""

    name = "a shell loop with care"
    options = "-o ControlMaster=auto -o ControlPath={folder}/%h -o ControlPersist=30"
    script = """\
create() { on $1 docker create --name bench -e TRIAL=$trial busybox "$service" >/dev/null; }
start() { on $1 docker start bench >/dev/null; }
await() { on $1 docker wait bench >/dev/null; }
collect() { on $1 docker logs -t bench >out/$trial/$1.log 2>&1; on $1 docker inspect bench >out/$trial/$1.json; }
remove() { on $1 docker rm -v bench >/dev/null; }
for step in create:create start:start await:wait collect:collect remove:remove; do
  each ${step%:*}
  mark ${step#*:}
done
done
each leave
"""


class Floor(Way):
    """The engines alone: requests straight to their sockets, all robots at once; nothing comes home, no SSH."""

    name = "the engines alone"
    network = "bridge"

    def run(self, count: int) -> list[Moments]:
        """Create, start, wait and remove."""
        engines = [_Engine(self._socket(name)) for name, _ in self.lab.robots]
        body = {"Image": "busybox", "Cmd": list(COMMAND), "HostConfig": {"NetworkMode": self.network}}
        requests: dict[str, tuple[str, str, Any]] = {
            "create": ("POST", "/containers/create?name=bench", body),
            "start": ("POST", "/containers/bench/start", None),
            "wait": ("POST", "/containers/bench/wait", None),
            "remove": ("DELETE", "/containers/bench?v=true", None),
        }
        found = []
        with ThreadPoolExecutor(len(engines)) as pool:
            for _ in range(count):
                moments = {"begin": time.monotonic()}
                for step, request in requests.items():
                    list(pool.map(_asker(request), engines))
                    moments[step] = time.monotonic()
                found.append(moments)
        return list(found)

    def _socket(self, robot: str) -> str:
        booted = state.read_robot(self.lab.site, robot)
        if booted is None:
            raise Trouble(f"{robot} is not up")
        return f"/proc/{booted.init.pid}/root/run/docker.sock"


class OwnNetwork(Floor):
    """The same in a network of its own on each robot, as srprov's services are, where they find each other by name."""

    name = "the engines alone, in a network of its own"
    network = "bench"

    def run(self, count: int) -> list[Moments]:
        """Make the network, and run them."""
        self.lab.everywhere(f"docker network create {self.network}")
        return super().run(count)


def _asker(request: tuple[str, str, Any]) -> Callable[[_Engine], None]:
    return lambda engine: engine.ask(*request)


class _Engine(http.client.HTTPConnection):
    """An engine's socket on a robot, by the path that the machine has for it."""

    def __init__(self, path: str) -> None:
        super().__init__("engine", timeout=_LONGEST_S)
        self._path = path

    def connect(self) -> None:
        """Connect to the socket."""
        self.sock = socket.socket(socket.AF_UNIX)
        self.sock.connect(self._path)

    def ask(self, method: str, path: str, body: object) -> None:
        """Do one thing, and wait for its end."""
        text = json.dumps(body) if body else None
        self.request(method, path, text, {"Content-Type": "application/json"} if text else {})
        answer = self.getresponse()
        said = answer.read()
        if answer.status >= 300:
            raise Trouble(f"{method} {path}: {answer.status} {said[:200]!r}")
