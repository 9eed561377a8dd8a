"""An experiment on four robots, ways to disturb its apply at a chosen event, and a look at all that it left there.

`tests/lab/test_survival.py` takes a few moments of it, `tools/soak` all of them. The looks go through Docker's and the
kernel's own commands on the robots; of srprov they know only the names.
"""

from __future__ import annotations

import json
import signal
import subprocess
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from srprov.lab import engine, state
from tests.lab.conftest import NOTHING, Done, Lab, busybox, edf, part_of_lab
from tests.lab.looks import begin, wait_until

ROBOTS = ("robot1", "robot2", "robot3", "robot4")
INSTANCE = "survive"
APPLY_LIMIT_S = 120.0
HEARTBEAT = "1,10,15"
"""Seconds: beat, controller gives up, robot's end gives up. Long enough for a fault that is made while it is frozen."""

_LOOK = r"""
docker inspect $(docker ps -aq) 2>/dev/null || true
echo ----
docker network inspect $(docker network ls -q --filter type=custom) 2>/dev/null || true
echo ----
docker volume inspect $(docker volume ls -q) 2>/dev/null || true
echo ----
docker images --no-trunc --format '{{.Repository}}:{{.Tag}} {{.ID}}'
echo ----
ip -j -d link show
echo ----
bridge -j fdb show
echo ----
cd /var/lib/srprov 2>/dev/null && find . -printf '%p %y %m %l\n' && find . -type f -exec sha256sum {} +
echo ----
grep -la SRPROV_SESSION= /proc/[0-9]*/environ 2>/dev/null
echo ----
shim='s/^[^ ]*containerd-shim[^ ]* .* -id \([0-9a-f]*\) .*/\1/p'
for p in $(grep -la containerd-shim /proc/[0-9]*/cmdline 2>/dev/null); do tr '\0' ' ' <$p | sed -n "$shim"; echo; done
true
"""


@dataclass(frozen=True)
class Seen:
    """What one robot has, of everything, whoever made it: a thing that is there twice is seen twice."""

    containers: dict[str, Any]
    networks: dict[str, Any]
    volumes: dict[str, Any]
    images: list[str]
    links: list[str]
    files: list[str]
    left_over: list[str]
    """Processes of a session that should be over."""
    shims: list[str]
    """Ids of containers that containerd has a shim for."""
    running: list[str]
    """Ids of containers that run, by Docker's word."""


def _container(one: dict[str, Any]) -> dict[str, Any]:
    labels, ends = one["Config"]["Labels"], one["NetworkSettings"]["Networks"]
    return {
        "config-hash": labels.get("srprov.config-hash"),
        "labels": {key: value for key, value in labels.items() if key.startswith("srprov.")},
        "image": one["Image"],
        "running": one["State"]["Running"],
        "mounts": sorted((m["Type"], m["Source"], m["Destination"], m["RW"]) for m in one["Mounts"]),
        "networks": {name: (end["IPAddress"], end["MacAddress"]) for name, end in ends.items()},
    }


def _links(text: str, neighbours: str) -> list[str]:
    """Give our links without what the kernel numbers or draws by itself, and their entries but for learned ones."""
    ours = [link for link in json.loads(text) if str(link.get("ifname", "")).startswith("srp")]
    lines = []
    for link in ours:
        about = link["linkinfo"]
        data = about["info_data"] if about["info_kind"] == "vxlan" else {}  # a bridge's is its MAC address and timers
        words = (link["ifname"], link.get("ifalias"), link["mtu"], about["info_kind"], "master" in link, link["flags"])
        lines.append(json.dumps([*words, data], sort_keys=True))
    names = {link["ifname"] for link in ours}
    for entry in json.loads(neighbours):
        if entry.get("ifname") in names and "dst" in entry and entry.get("state") == "permanent":
            lines.append(f"{entry['ifname']}: {entry['mac']} dst {entry['dst']}")
    return sorted(lines)


def _parse(text: str) -> Seen:
    containers, networks, volumes, images, links, neighbours, files, left_over, shims = text.split("----\n")
    there = json.loads(containers or "[]")
    named = {one["Name"].lstrip("/"): _container(one) for one in there}
    assert len(named) == len(there)
    nets = json.loads(networks or "[]")
    by_name = {n["Name"]: {key: n[key] for key in ("Driver", "IPAM", "Labels", "Options", "Internal")} for n in nets}
    assert len(by_name) == len(nets), f"a network is there twice: {sorted(n['Name'] for n in nets)}"
    kept = {v["Name"]: {key: v[key] for key in ("Driver", "Labels", "Options")} for v in json.loads(volumes or "[]")}
    return Seen(
        named,
        by_name,
        kept,
        sorted(images.splitlines()),
        _links(links, neighbours),
        sorted(files.splitlines()),
        left_over.split(),
        sorted(shims.split()),
        sorted(one["Id"] for one in there if one["State"]["Running"]),
    )


def look(lab: Lab) -> dict[str, Seen]:
    """Give robot -> what it has."""
    with ThreadPoolExecutor(len(ROBOTS)) as pool:
        texts = pool.map(lambda robot: lab.shell(robot, "sh", "-c", _LOOK).out, ROBOTS)
        return {robot: _parse(text) for robot, text in zip(ROBOTS, texts, strict=True)}


@dataclass(frozen=True)
class Survivor:
    """The experiment, and what an undisturbed apply of it leaves."""

    lab: Lab
    folder: Path
    words: tuple[str, ...]
    """The EDF and the inventory, as arguments."""
    undisturbed: dict[str, Seen]
    ids: tuple[str, ...]
    """Of its steps."""

    @property
    def steps(self) -> int:
        return len(self.ids)

    def apply(self, *more: str) -> Done:
        return self.lab.srprov("apply", *self.words, "--yes", "--json", "--settle", "0.5", *more)

    def begin(self) -> tuple[subprocess.Popen[str], Path]:
        """Start an apply; give it and the file of its events."""
        events = self.folder / "events.jsonl"
        events.unlink(missing_ok=True)
        common = ("apply", *self.words, "--yes", "--json", "--settle", "0.5", "--heartbeat", HEARTBEAT)
        return begin(self.lab, *common, "--events", str(events)), events

    def disturb(self, kind: str, count: int, act: Callable[[subprocess.Popen[str]], None], of: str = "") -> Done:
        """Apply, and when `count` events of a kind, of steps whose ids begin with `of`, have been, do something.

        The process is frozen meanwhile, so that it meets the fault in the middle of what it does.
        """
        run, events = self.begin()
        try:
            _until(lambda: counted(events, kind, of) >= count or run.poll() is not None, APPLY_LIMIT_S)
            if run.poll() is None:
                run.send_signal(signal.SIGSTOP)
                try:
                    act(run)
                finally:
                    run.send_signal(signal.SIGCONT)
            out, err = run.communicate(timeout=APPLY_LIMIT_S)
        finally:
            run.kill()
        return Done(run.returncode, out, err)

    def kill_engine_while_it_starts(self, robot: str, after_s: float) -> Done:
        """Apply, and kill a robot's engine so many seconds after it made a container."""
        booted = state.read_robot(self.lab.site, robot)
        assert booted is not None
        folder = Path(f"/proc/{booted.init.pid}/root/var/lib/docker/containers")
        before = set(folder.iterdir())
        run, _ = self.begin()
        try:
            _until(lambda: set(folder.iterdir()) - before or run.poll() is not None, APPLY_LIMIT_S)
            time.sleep(after_s)  # the moment of the kill, not a wait for something
            engine.kill(self.lab.site, robot, booted.init.pid)
            out, err = run.communicate(timeout=APPLY_LIMIT_S)
        finally:
            run.kill()
        return Done(run.returncode, out, err)

    def assert_converges(self) -> Done:
        """The next apply ends well, the one after it has nothing to do, and the robots are as if nothing had been."""
        again = self.apply("--lock-wait", "20")
        assert again.code == 0, again
        self.assert_whole()
        third = self.apply()
        assert (third.code, third.json["changed"], third.json["steps"]) == (0, 0, []), third
        return again

    def assert_whole(self) -> None:
        """Everything is there once and right, nobody holds a lock, nothing runs on."""
        locks = self.lab.srprov("locks", "-i", self.words[-1], "--json")
        assert locks.code == 0, locks
        assert locks.json["robots"] == dict.fromkeys(ROBOTS), locks
        seen = look(self.lab)
        for robot in ROBOTS:
            for part in ("containers", "networks", "volumes", "images", "links", "files"):
                now, then = getattr(seen[robot], part), getattr(self.undisturbed[robot], part)
                assert now == then, f"{robot}: {part} are not as after an undisturbed apply: {now}; then: {then}"
            assert seen[robot].left_over == [], f"{robot}: a process runs on"
            assert seen[robot].shims == seen[robot].running, f"{robot}: a shim without its container is left"

    def clear(self) -> None:
        """Destroy all of it; the robots are empty then, and pull their images again next time."""
        gone = self.lab.srprov("destroy", self.words[0], *self.words[1:], "--yes", "--volumes", "--lock-wait", "20")
        assert gone.code == 0, gone
        with ThreadPoolExecutor(len(ROBOTS)) as pool:
            left = dict(zip(ROBOTS, pool.map(self.lab.leftovers, ROBOTS), strict=True))
            assert left == dict.fromkeys(ROBOTS, NOTHING), f"destroy ended well and left {left}: {gone}"
            list(pool.map(lambda robot: self.lab.shell(robot, "docker", "image", "prune", "--all", "--force"), ROBOTS))


def wait_for_engine(lab: Lab, robot: str) -> None:
    """Wait until the robot's dockerd, which its supervisor starts again, answers."""
    wait_until(
        lambda: lab.shell(robot, "docker", "version", check=False).code == 0, 30, f"the engine of {robot} is back"
    )


def kill(run: subprocess.Popen[str]) -> None:
    """SIGKILL: no handler runs, nothing is said goodbye to."""
    run.kill()


def counted(events: Path, kind: str, of: str = "") -> int:
    """Count the events of a kind, of steps whose ids begin with `of`, in a file which is being written."""
    if not events.exists():
        return 0
    said = (json.loads(line) for line in events.read_text(encoding="utf-8").split("\n")[:-1])
    return sum(event["event"] == kind and (event["id"] or "").startswith(of) for event in said)


def prepare(lab: Lab, folder: Path) -> Survivor:
    """Write the experiment, apply it undisturbed, keep what that leaves, and destroy it again."""
    (folder / "config" / "deep").mkdir(parents=True)
    (folder / "config" / "greeting.txt").write_text("hello\n", encoding="utf-8")
    (folder / "config" / "deep" / "blob.bin").write_bytes(bytes(range(256)) * 64)
    services = {
        "store": busybox(robot="robot1", volumes=["data:/data"]),
        "shipped": busybox(robot="robot2", volumes=["./config:/config"]),
        "after": busybox(robot="robot3", depends_on={"store": {"condition": "started"}}),
        "last": busybox(robot="robot4", depends_on={"after": {"condition": "started"}}),
        "side": busybox(robot="robot1"),
        "both": busybox(robot="robot2", volumes=["./config:/etc/both", "more:/more"], depends_on=["shipped"]),
    }
    path = folder / f"{INSTANCE}.edf"
    path.write_text(edf(INSTANCE, services, placement={"slots_per_robot": 2}), encoding="utf-8")
    inventory = part_of_lab(lab, ROBOTS, folder / "lab.yml")
    made = Survivor(lab, folder, (str(path), "-i", inventory), {}, ())
    made.clear()  # images of other tests too: what is compared is what this experiment leaves
    first = made.apply()
    assert first.code == 0, first
    seen = look(lab)
    names = [name for robot in ROBOTS for name in seen[robot].containers]
    assert sorted(names) == sorted(f"srprov.{INSTANCE}.{service}" for service in services)
    assert all(seen[robot].links and seen[robot].files and seen[robot].networks for robot in ROBOTS), seen
    ready = Survivor(lab, folder, made.words, seen, tuple(step["id"] for step in first.json["steps"]))
    ready.assert_whole()
    ready.clear()
    return ready


def _until(holds: Callable[[], bool], seconds: float) -> None:
    until = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < until, f"not within {seconds:g} s"
        time.sleep(0.005)
