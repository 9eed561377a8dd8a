"""The lab, for the benchmark alone, and means to look at and clean its robots that are nobody's contestant.

Robots are entered by nsenter, as `srprov lab shell` does; no SSH is involved.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from srprov.lab import lab as labs
from srprov.lab.places import Site, robot_name
from srprov.lab.sites import find

ROOT = Path(__file__).parents[2]
SITE = Site(os.environ.get("SRPROV_LAB", ""), number=None)
"""The lab, by its name; `Lab.site` also knows its number, which a lab with a name has only while it is up."""
LOCK = "-".join(filter(None, ["/run/lock/srprov-lab-tests", SITE.name]))
KEY, KNOWN_HOSTS = SITE.key, SITE.known_hosts
RESET = (
    'c=$(docker ps -aq); test -z "$c" || docker rm -f $c >/dev/null; '
    "n=$(docker network ls -q --filter type=custom --filter driver=bridge | sort -u); "
    'for i in $n; do test "$(docker network inspect -f "{{.Name}}" $i)" = docker_gwbridge || '
    "docker network rm $i >/dev/null; done; "
    'for l in $(ls /sys/class/net | grep -E "^(srp|bench)"); do ip link del $l; done; '
    "nft list tables | while read -r _ f t; do case $t in srp*) nft delete table $f $t;; esac; done; "
    "rm -rf /var/lib/srprov /run/srprov/*/ /root/.ansible /tmp/pyinfra* /tmp/ansible*"
)
LOOK = (
    'c=$(docker ps -q); test -n "$c" && docker inspect $c || echo "[]"; echo ----; '
    "ip -j -d link show type vxlan; echo ----; bridge -j fdb show"
)


class Trouble(Exception):
    """The lab, or what a tool left on it, isn't as it should be."""


@dataclass(frozen=True)
class Lab:
    """Robots that are up, and the folder with their inventory."""

    folder: Path
    robots: tuple[tuple[str, str], ...]
    """Name and address of each."""
    latency_ms: int
    site: Site

    @property
    def inventory(self) -> Path:
        """The inventory that `srprov lab up` wrote."""
        return self.folder / SITE.inventory

    def enter(self, robot: str, script: str, limit_s: float = 120, stdin: bytes = b"") -> str:
        """Run a shell script on a robot, past its network; give what it prints."""
        argv = labs.shell(SITE.name, robot, ["sh", "-c", script])
        done = subprocess.run(argv, capture_output=True, input=stdin, timeout=limit_s, check=False)
        if done.returncode:
            raise Trouble(f"{robot}: {script[:60]}: exit {done.returncode}: {done.stderr.decode().strip()[-300:]}")
        return done.stdout.decode()

    def everywhere(self, script: str, workers: int = 8, stdin: bytes = b"") -> dict[str, str]:
        """Run a shell script on all robots; robot -> what it printed."""
        names = [name for name, _ in self.robots]
        with ThreadPoolExecutor(workers) as pool:
            answers = pool.map(lambda name: self.enter(name, script, stdin=stdin), names)
            return dict(zip(names, answers, strict=True))

    def reset(self) -> None:
        """Remove from all robots what any tool may have left."""
        self.everywhere(RESET)

    def look(self) -> dict[str, dict[str, Any]]:
        """Return robot -> running containers (name, id, pid, env, addresses), VXLAN links and their entries."""
        return {robot: _seen(text) for robot, text in self.everywhere(LOOK).items()}


def _seen(text: str) -> dict[str, Any]:
    containers, links, entries = (json.loads(part or "[]") for part in text.split("----\n"))
    names = [link["ifname"] for link in links if link.get("master")]
    return {
        "containers": [
            {
                "id": one["Id"],
                "pid": one["State"]["Pid"],
                "env": one["Config"]["Env"],
                "addresses": {name: net["IPAddress"] for name, net in one["NetworkSettings"]["Networks"].items()},
            }
            for one in containers
            if one["State"]["Running"]
        ],
        "links": names,
        "vteps": sorted({entry["dst"] for entry in entries if entry.get("ifname") in names and entry.get("dst")}),
    }


def _srprov(*words: str, cwd: Path, limit_s: float = 400) -> None:
    argv = [sys.executable, "-m", "srprov", "lab", "--name", SITE.name, *words]
    done = subprocess.run(argv, cwd=cwd, capture_output=True, text=True, timeout=limit_s, check=False)
    if done.returncode:
        raise Trouble(f"srprov lab {' '.join(words)}: exit {done.returncode}: {done.stderr.strip()[-500:]}")


@contextlib.contextmanager
def guarded(patience_s: float) -> Iterator[None]:
    """Hold the lock that tests of this machine take around the lab."""
    deadline = time.monotonic() + patience_s
    told = False
    with open(LOCK, "w", encoding="utf-8") as guard:
        while True:
            try:
                fcntl.flock(guard, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if time.monotonic() > deadline:
                    raise Trouble(f"somebody else used the lab for {patience_s:g} s") from None
            if not told:
                print("waiting for the lab, which somebody else uses", file=sys.stderr)
                told = True
            time.sleep(0.5)
        yield


@contextlib.contextmanager
def _neighbours(count: int) -> Iterator[None]:
    """Let the kernel remember as many neighbours as so many robots have; all network namespaces share one table."""
    settings = [Path(f"/proc/sys/net/ipv4/neigh/default/gc_thresh{index}") for index in (3, 2, 1)]
    before = [setting.read_text() for setting in settings]
    needed = 2 * count * count
    try:
        for setting in settings:
            setting.write_text(str(max(needed, int(setting.read_text()))))
        yield
    finally:
        for setting, value in reversed(list(zip(settings, before, strict=True))):
            setting.write_text(value)


def _end(*_: object) -> None:
    """End, and let what ends labs and links come to its end: `timeout` gives its signal twice."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    sys.exit(143)


@contextlib.contextmanager
def lab(count: int, latency_ms: int = 0, patience_s: float = 1800) -> Iterator[Lab]:
    """Bring up a fresh lab of `count` robots that have the image, and take it down in the end."""
    signal.signal(signal.SIGTERM, _end)  # so that `timeout` and `kill` leave no lab behind
    with guarded(patience_s), _neighbours(count), tempfile.TemporaryDirectory(prefix="srprov-bench-") as name:
        folder = Path(name)
        late = {"defaults": {"ssh_latency_ms": latency_ms}} if latency_ms else {}
        (folder / "lab-spec.yml").write_text(json.dumps({"count": count, **late}), encoding="utf-8")
        _srprov("down", cwd=folder)
        try:
            _srprov("up", "--spec", "lab-spec.yml", cwd=folder)
            site = find(SITE.name)
            robots = tuple((robot, str(site.address(robot))) for robot in _names(count))
            made = Lab(folder, robots, latency_ms, site)
            made.everywhere("docker image inspect busybox >/dev/null 2>&1 || docker pull -q busybox >/dev/null")
            yield made
        finally:
            _srprov("down", cwd=folder)


def _names(count: int) -> Sequence[str]:
    return [robot_name(number) for number in range(1, count + 1)]
