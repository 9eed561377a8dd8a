"""A lab of real robots, the command line as users have it, and ways to look at a robot that do not go through srprov.

Each process of tests has a lab of its own: `test`, or `test-gw0` and `test-gw1` where pytest-xdist runs two. The
session fixture brings it up for the first test that needs it and takes it down in the end; each test leaves its robots
clean. SRPROV_LAB=NAME takes other names, for two people who test at once.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import re
import socket
import subprocess
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from srprov.lab import members, overview, state
from srprov.lab.lab import down
from srprov.lab.places import Site
from srprov.lab.robot import enter
from srprov.lab.sites import every, find
from tests.lab.warm import Warm

ROOT = Path(__file__).parents[2]
ROBOTS = int(os.environ.get("SRPROV_LAB_ROBOTS", "13"))
"""`tools/soak` asks for fewer where its tests need fewer."""
NAME = "-".join(filter(None, [os.environ.get("SRPROV_LAB") or "test", os.environ.get("PYTEST_XDIST_WORKER")]))
"""The lab of this process."""
# where other machines take the processors, a robot that is well is silent for longer than the usual 20 s
os.environ.setdefault("SRPROV_HEARTBEAT", "5,60,90")
os.environ["SRPROV_LAB"] = NAME  # for every `srprov lab` that a test starts
GUARDS = "/run/lock/srprov-lab-tests-"
GUARD = Path(os.environ.get("SRPROV_LAB_GUARD", GUARDS + NAME))
"""Who has the lab holds a lock on it. `tools/soak` has the lab already when it starts tests, and names another file."""
COMMAND_LIMIT_S = 560
WARM = Warm()


@dataclass(frozen=True)
class Done:
    """What a command line left behind."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        return json.loads(self.out)

    def __str__(self) -> str:
        return f"exit {self.code}\n--- out\n{self.out}\n--- err\n{self.err}"


def run_srprov(*arguments: str, cwd: Path, stdin: str | None = None, env: dict[str, str] | None = None) -> Done:
    """Run `srprov` as a user does: a process of its own, no terminal."""
    whole = {**os.environ, "PYTHONPATH": str(ROOT), **(env or {})}
    if "PYTHONPATH" not in (env or {}):
        return Done(*WARM.run(arguments, cwd, whole, stdin or "", COMMAND_LIMIT_S))
    done = subprocess.run(  # what it imports is another thing than what is warm
        [sys.executable, "-m", "srprov", *arguments],
        cwd=cwd,
        env=whole,
        input=stdin or "",
        capture_output=True,
        text=True,
        timeout=COMMAND_LIMIT_S,
        check=False,
    )
    return Done(done.returncode, done.stdout, done.stderr)


class Lab:
    """The robots, by independent means: a shell in their namespaces, and Docker's own command line there."""

    def __init__(self, folder: Path, name: str = NAME) -> None:
        self.folder = folder
        self.name = name
        self.inventory = folder / Site(name).inventory

    @property
    def site(self) -> Site:
        """Its folders, names and addresses on this machine."""
        return find(self.name)

    def srprov(self, *arguments: str, **more: Any) -> Done:
        """Run `srprov` from the lab's folder, where `lab up` has written its inventory."""
        more["env"] = {"SRPROV_LAB": self.name, **(more.get("env") or {})}
        return run_srprov(*arguments, cwd=self.folder, **more)

    def shell(self, robot: str, *words: str, check: bool = True, limit_s: float = COMMAND_LIMIT_S) -> Done:
        """Run a command on a robot through its namespaces, not through SSH.

        As `srprov lab shell` does it, without a Python of its own for each: there are thousands of these.
        """
        program = enter(self.site, robot, words)
        ran = subprocess.run(program, input="", capture_output=True, text=True, timeout=limit_s, check=False)
        done = Done(ran.returncode, ran.stdout, ran.stderr)
        assert not check or done.code == 0, f"{robot}: {' '.join(words)}: {done}"
        return done

    def inspect(self, robot: str, name: str) -> dict[str, Any]:
        """Give `docker inspect` of a container."""
        found = json.loads(self.shell(robot, "docker", "inspect", name).out)
        assert isinstance(found[0], dict)
        return found[0]

    def containers(self, robot: str, *, running: bool = False) -> dict[str, str]:
        """Give name -> id of a robot's containers."""
        every = [] if running else ["--all"]
        out = self.shell(robot, "docker", "ps", *every, "--no-trunc", "--format", "{{.Names}} {{.ID}}").out
        return dict(line.split() for line in out.splitlines())

    def everywhere(self, robots: Sequence[str]) -> dict[str, dict[str, str]]:
        """Give robot -> its containers by name and id."""
        return {robot: self.containers(robot) for robot in robots}

    def leftovers(self, robot: str) -> dict[str, list[str]]:
        """Give all that srprov could have left on a robot, by Docker's, the kernel's and the disk's own word."""
        script = (
            "docker ps -a --format {{.Names}} --filter label=srprov.instance; echo --; "
            "docker network ls --format {{.Name}} --filter label=srprov.instance; echo --; "
            "docker volume ls --format {{.Name}} --filter label=srprov.instance; echo --; "
            "{ ls /sys/class/net /run/netns /run/wireguard | grep ^srp; "
            "{ nft list tables; iptables-save; ip6tables-save; } | grep srpv; } 2>/dev/null; echo --; "
            "find /var/lib/srprov -mindepth 1 2>/dev/null; "
            "find /etc/systemd/system -name 'srprov-*' 2>/dev/null; true"
        )
        parts = self.shell(robot, "sh", "-c", script).out.split("--\n")
        return dict(
            zip(("containers", "networks", "volumes", "links", "files"), (p.split() for p in parts), strict=True)
        )


NOTHING: dict[str, list[str]] = {"containers": [], "networks": [], "volumes": [], "links": [], "files": []}


def only_the_record(instance: str) -> dict[str, list[str]]:
    """Give what is left on a robot that runs nothing any more: it is a witness of the placement."""
    folder = f"/var/lib/srprov/{instance}"
    return {**NOTHING, "files": [folder, f"{folder}/placement.json"]}


BEGUN: list[subprocess.Popen[str]] = []


@pytest.fixture(autouse=True)
def _none_outlives_its_test() -> Iterator[None]:
    """Kill what a test began in the background and left running: its locks would fail the tests after it."""
    before = len(BEGUN)
    yield
    for run in BEGUN[before:]:
        if run.poll() is None:
            run.kill()
            run.wait()


@pytest.fixture(scope="session")
def lab_session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    """Bring the lab up once for all tests, and down after them."""
    folder = tmp_path_factory.mktemp("lab")
    lab = Lab(folder)
    with GUARD.open("w", encoding="utf-8") as guard:
        # two test runs at once would clean each other's robots away
        fcntl.flock(guard, fcntl.LOCK_EX)
        # a lab that is up already may hold what somebody tried; tests begin with fresh robots
        assert lab.srprov("lab", "down").code == 0
        up = lab.srprov("lab", "up", "-n", str(ROBOTS))
        assert up.code == 0, up
        os.environ.setdefault("SRPROV_RUNS", str(folder / "runs"))  # not among the user's own
        os.environ["XDG_CONFIG_HOME"] = str(folder / "config")  # nor by the user's own settings
        settings = folder / "config" / "srprov" / "srprov.toml"
        settings.parent.mkdir(parents=True)
        settings.write_text("timeout = 30\n", encoding="utf-8")  # as for SRPROV_HEARTBEAT
        os.environ.setdefault("XDG_STATE_HOME", str(folder / "state"))
        os.environ.setdefault("XDG_CACHE_HOME", str(folder / "cache"))
        yield lab
        gone = lab.srprov("lab", "down")
        assert gone.code == 0, gone


def pytest_unconfigure() -> None:
    """Take down the labs of pytest-xdist's workers that were ended in the middle of a test."""
    if "PYTEST_XDIST_WORKER" in os.environ:
        return
    for site in every():
        worker = re.match(rf"{NAME}-gw[0-9]+(?=-|$)", site.name)
        if worker is not None:
            with open(GUARDS + worker[0], "w", encoding="utf-8") as guard, contextlib.suppress(BlockingIOError):
                fcntl.flock(guard, fcntl.LOCK_EX | fcntl.LOCK_NB)  # held while the worker lives, whoever started it
                down(site.name, print)


def make_whole(lab: Lab) -> None:
    """Have all robots ready, as they are by default; `lab up` is only run where a test has left something to do."""
    known = state.read_lab(lab.site)
    assert known is not None, "a test has taken the lab down"
    default = (known.spec["text"], known.spec["count"], known.user) == ("", ROBOTS, None)
    if not (default and all(seen.state == "ready" and not seen.faults for seen in overview.robots(lab.name))):
        up = lab.srprov("lab", "up", "-n", str(ROBOTS))
        assert up.code == 0, up


def scrub(lab: Lab) -> None:
    """Remove what tests may have left on robots, by Docker's and the kernel's own means."""
    script = (
        'c=$(docker ps -aq); test -z "$c" || docker rm -f $c >/dev/null; '
        'n=$(docker network ls -q --filter type=custom); test -z "$n" || docker network rm $n >/dev/null; '
        'v=$(docker volume ls -q); test -z "$v" || docker volume rm -f $v >/dev/null; '
        "for l in $(ls /sys/class/net | grep ^srp); do ip link del $l; done; "
        "nft list tables | grep ' srpv' | while read -r t; do nft delete $t; done; "
        "for n in $(ls /run/netns 2>/dev/null | grep ^srpw); do ip netns del $n; done; "
        "rm -rf /var/lib/srprov /run/srprov/*/; rm -f $(find /etc/systemd/system -name 'srprov-*')"
    )
    site = lab.site
    robots = [each.name for each in members.of(members.require_up(site))]
    with ThreadPoolExecutor(4) as pool:
        clean = list(pool.map(partial(is_clean, site), robots))
        used = [robot for robot, nothing in zip(robots, clean, strict=True) if not nothing]
        list(pool.map(lambda robot: lab.shell(robot, "sh", "-c", script), used))


def is_clean(site: Site, robot: str) -> bool:
    """Return whether a robot has nothing that `scrub` would remove, by the kernel's word and its engine's."""
    booted = state.read_robot(site, robot)
    assert booted is not None, f"{robot} is dead"
    root = Path(f"/proc/{booted.init.pid}/root")
    links = Path(f"/proc/{booted.init.pid}/net/dev").read_text(encoding="utf-8")
    if (
        (root / "var/lib/srprov").exists()
        or any(root.glob("etc/systemd/system/srprov-*"))
        or any(root.glob("run/srprov/*/"))
        or any(root.glob("run/netns/srpw*"))
        or re.search("^ *srp", links, re.MULTILINE)
    ):
        return False
    try:
        asked = {path: engine_says(root / "run/docker.sock", path) for path in KEPT}
    except OSError:  # its engine is down: the script says why where that is wrong
        return False
    return not (asked[CONTAINERS] or asked[NETWORKS] or asked[VOLUMES]["Volumes"])


CONTAINERS, VOLUMES = "/containers/json?all=1", "/volumes"
NETWORKS = "/networks?filters=%7B%22type%22%3A%5B%22custom%22%5D%7D"
KEPT = (CONTAINERS, NETWORKS, VOLUMES)


def engine_says(engine: Path, path: str) -> Any:
    """Return the answer of an engine, asked through its socket's file."""
    with socket.socket(socket.AF_UNIX) as connection:
        connection.settimeout(10)
        connection.connect(str(engine))
        connection.sendall(f"GET {path} HTTP/1.0\r\n\r\n".encode())
        with connection.makefile("rb") as answer:
            return json.loads(answer.read().partition(b"\r\n\r\n")[2])


@pytest.fixture
def lab(lab_session: Lab) -> Iterator[Lab]:
    """Give the lab with clean robots, all of them up with the default inventory; clean them again afterwards."""
    make_whole(lab_session)
    yield lab_session
    scrub(lab_session)


@pytest.fixture(scope="module")
def lab_of_module(lab_session: Lab) -> Iterator[Lab]:
    """Give the lab as `lab` does, but once for a whole file, whose tests then keep to robots of their own."""
    make_whole(lab_session)
    yield lab_session
    scrub(lab_session)


@pytest.fixture
def write(tmp_path: Path) -> Any:
    """Give a function that writes a file of an experiment and gives its path."""

    def _write(name: str, text: str) -> str:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        return str(path)

    return _write


def part_of_lab(lab: Lab, robots: Sequence[str], path: Path, **extra: dict[str, Any]) -> str:
    """Write an inventory with only some robots of the lab, and more variables for some; give its path."""
    import yaml

    whole = yaml.safe_load(lab.inventory.read_text(encoding="utf-8"))
    hosts = {name: {**whole["all"]["hosts"][name], **extra.get(name, {})} for name in robots}
    path.write_text(yaml.safe_dump({"all": {"hosts": hosts, "vars": whole["all"].get("vars", {})}}), encoding="utf-8")
    return str(path)


def busybox(*command: str, **more: Any) -> dict[str, Any]:
    """Give a service that runs `command`, or sleeps; it ends at once when it is stopped."""
    return {"image": "busybox", "command": list(command or ("sleep", "86400")), "stop_signal": "SIGKILL", **more}


def edf(name: str, services: dict[str, dict[str, Any]], **more: Any) -> str:
    """Give an EDF's text; JSON is YAML."""
    return json.dumps({"edf": 1, "name": name, "services": services, **more}, indent=2)


def causes(plan: dict[str, Any]) -> dict[str, str]:
    """Give step id -> action and cause, of what `plan --json` printed."""
    steps = plan["steps"]
    found = {f"{s['robot']}/{s['module']}:{s['name']}": f"{s['action']}: {s['cause']}" for s in steps}
    assert len(found) == len(steps), steps
    return found


def changed(report: dict[str, Any]) -> set[str]:
    """Give the ids of the steps that `apply --json` reported as changed."""
    return {step["id"] for step in report["steps"] if step["outcome"] == "changed"}


@pytest.fixture
def mended(lab_of_module: Lab) -> Iterator[Lab]:
    """Give the lab to a test that kills robots or gives them other options; afterwards they are as they were."""
    yield lab_of_module
    make_whole(lab_of_module)
