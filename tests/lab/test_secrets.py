"""Secrets on real robots: the service reads the right value, and nothing else in the world shows it.

Every kind of secret holds a word that occurs nowhere else. Whatever srprov prints and writes, whatever lies on the
robots and stands in /proc while it runs is searched for those words, plain and in base64; the robots are namespaces of
this machine, so its /proc has their processes too.
"""

from __future__ import annotations

import base64
import json
import os
import pty
import re
import select
import stat
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.lab.conftest import ROOT, Done, Lab, busybox, causes, edf, part_of_lab

pytestmark = pytest.mark.lab

CANARIES = {
    "by-env": "canary-env-5b1f\"'$x",
    "by-file": "canary-file-77aa\nsecond-line-of-canary-file\n",
    "by-command": "canary-command-c0de%/+",
}
PASSWORDS = {"ansible_password": "canary-password-0001", "ansible_become_password": "canary-become-0002"}
WORDS = ("canary-env-5b1f", "canary-file-77aa", "second-line-of-canary", "canary-command-c0de", *PASSWORDS.values())
NEEDLES = (*WORDS, *(base64.b64encode(word.encode()).decode()[:16] for word in WORDS))


def seen_in(text: str) -> list[str]:
    """Give the words that stand in a text."""
    return [needle for needle in NEEDLES if needle in text]


class Sampler(threading.Thread):
    """Looks again and again at the arguments and environments of all processes of this machine and of its robots."""

    def __init__(self, *needles: str) -> None:
        super().__init__(daemon=True)
        self.needles = [needle.encode() for needle in needles or NEEDLES]
        self.found: set[str] = set()
        self.rounds = 0
        self.over = threading.Event()

    def run(self) -> None:
        while not self.over.is_set():
            for pid in filter(str.isdigit, os.listdir("/proc")):
                self._look(pid)
            self.rounds += 1

    def _look(self, pid: str) -> None:
        try:
            words = Path(f"/proc/{pid}/cmdline").read_bytes()
            environ = Path(f"/proc/{pid}/environ").read_bytes()
        except OSError:
            return
        # srprov itself was given one of them by its environment, and is the same process before a child's exec
        given = b"-m\0srprov\0" in words and b"CANARY_BY_ENV=" in environ
        for needle in self.needles:
            if needle in words or (needle in environ and not given):
                self.found.add(f"{needle.decode()} in process {words!r}")


@contextmanager
def sampled(*needles: str) -> Iterator[Sampler]:
    """Look at all processes during a block; nothing may have been found in the end."""
    sampler = Sampler(*needles)
    sampler.start()
    try:
        yield sampler
    finally:
        sampler.over.set()
        sampler.join()
    assert sampler.rounds > 3
    assert sampler.found == set()


def test_the_look_at_processes_sees_what_is_there(lab: Lab) -> None:
    """An argument and an environment, here and on a robot: else finding nothing would say nothing."""
    for number, words in enumerate((["sh", "-c", ": canary-arg; sleep 3"], ["env", "X=canary-arg", "sleep", "3"])):
        with pytest.raises(AssertionError, match="canary-arg"), sampled("canary-arg"):
            if number:
                subprocess.run(words, check=True)
            else:
                lab.shell("robot1", *words)


class Stage:
    """An experiment with a secret of each kind, its inventory with passwords, and all that srprov ever said of it."""

    def __init__(self, lab: Lab, folder: Path, robots: list[str]) -> None:
        self.lab, self.folder, self.robots = lab, folder, robots
        self.values = dict(CANARIES)
        self.inventory = part_of_lab(lab, robots, folder / "lab.yml", **dict.fromkeys(robots, PASSWORDS))
        self.runs = folder / "runs"
        self.said: list[str] = []
        self.path = folder / "experiment.edf"
        (folder / "print-it").write_text(f"#!{sys.executable}\nprint(open({str(folder / 'kept')!r}).read())\n")
        (folder / "print-it").chmod(0o755)
        self.write_values()

    def write_values(self) -> None:
        """Put today's values where they come from."""
        (self.folder / "by-file").write_text(self.values["by-file"])
        (self.folder / "kept").write_text(self.values["by-command"])

    def define(self, **services: dict[str, Any]) -> None:
        """Write the EDF."""
        secrets = {
            "by-env": {"env": "CANARY_BY_ENV"},
            "by-file": {"file": "by-file"},
            "by-command": {"command": ["./print-it"]},
        }
        self.path.write_text(edf("canary", services, secrets=secrets, placement={"slots_per_robot": 4}))

    def run(self, verb: str, *arguments: str, code: int = 0, **env: str) -> Done:
        """Run srprov with the secrets given to it; keep what it says."""
        given = {"CANARY_BY_ENV": self.values["by-env"], "SRPROV_RUNS": str(self.runs), **env}
        kinds = ("secret", "secret-command", "restart-always") if verb in ("plan", "apply") else ()
        allowed = [word for kind in kinds for word in ("--allow", kind)]
        done = self.lab.srprov(verb, *arguments, *allowed, "-i", self.inventory, env=given)
        self.said.append(f"{verb} {done}")
        assert done.code == code, done
        return done

    def apply(self, *more: str, code: int = 0) -> Done:
        """Apply with the shortest settle time that still sees a service die."""
        return self.run("apply", str(self.path), "--yes", "--settle", "0.5", *more, code=code)

    def read(self, robot: str, container: str, path: str) -> str:
        """Read a file inside a container, byte for byte, past srprov."""
        script = 'docker exec "$0" cat "$1" | base64 -w0'
        return base64.b64decode(self.lab.shell(robot, "sh", "-c", script, container, path).out).decode()


@pytest.fixture
def stage(lab: Lab, tmp_path: Path) -> Stage:
    """Give the stage on two robots."""
    return Stage(lab, tmp_path, ["robot1", "robot2"])


EVERY = ["by-env", "by-file", "by-command"]


def test_no_canary_is_seen_anywhere(stage: Stage) -> None:
    """Not through plan, plan file, applies that work and that fail, status, logs and destroy; the service reads all."""
    lab = stage.lab
    stage.define(
        reader=busybox(robot="robot1", secrets=EVERY),
        other=busybox("sh", "-c", "echo here; sleep 86400", robot="robot2", secrets=["by-file"]),
    )
    edf_path, plan_file = str(stage.path), stage.folder / "plan.json"
    with sampled():
        stage.run("plan", edf_path, "-v")
        stage.run("plan", edf_path, "--json")
        stage.run("plan", edf_path, "-o", str(plan_file), "--format", "markdown")
        stage.run("apply", str(plan_file), "--yes", "-v", "--events", str(stage.folder / "events-1"), "--settle", "0.5")
        for name in EVERY:
            assert stage.read("robot1", "srprov.canary.reader", f"/run/secrets/{name}") == CANARIES[name]
        broken = busybox("sh", "-c", "exit 7", robot="robot1", secrets=["by-env"])
        stage.define(reader=busybox(robot="robot1", secrets=EVERY), broken=broken)
        stage.apply("-v", "--events", str(stage.folder / "events-2"), code=3)
        stage.apply("--json", "--events", str(stage.folder / "events-3"), code=3)
        stage.run("status", edf_path)
        stage.run("status", edf_path, "--json")
        stage.run("logs", edf_path)
        inspected = [json.dumps(lab.inspect(robot, name)) for robot in stage.robots for name in lab.containers(robot)]
        stage.run("destroy", edf_path, "--yes", "-v", "--events", str(stage.folder / "events-4"))
    assert [seen_in(text) for text in inspected] == [[]] * len(inspected) and inspected
    for text in stage.said:
        assert seen_in(text) == [], text
    files = [plan_file, *stage.folder.glob("events-*"), *(path for path in stage.runs.rglob("*") if path.is_file())]
    assert len(list(stage.runs.iterdir())) == 4
    for path in files:
        assert seen_in(path.read_text()) == [], path
    places = "/var/lib/srprov /run/srprov /var/log /tmp /root /var/lib/docker/containers /dev/shm"
    for robot in stage.robots:
        grep = " ".join(f"-e '{word}'" for word in WORDS)
        found = lab.shell(robot, "sh", "-c", f"grep -rlaF {grep} {places} 2>/dev/null; true").out
        assert found == "", found
        assert lab.leftovers(robot)["files"] == []
        assert lab.shell(robot, "sh", "-c", "find /run/srprov -mindepth 1 -type d; true").out == ""


def test_a_bug_and_a_talkative_service_show_no_value(stage: Stage) -> None:
    """A traceback whose text holds the value, from a thread and from the main one, and the dying words of a service."""
    stage.define(reader=busybox("sh", "-c", "cat /run/secrets/by-*; exit 3", robot="robot1", secrets=EVERY))
    dying = stage.apply("--settle", "5", code=3)
    assert "its last lines" in dying.err and "***" in dying.err
    hook = stage.folder / "hook"
    hook.mkdir()
    (hook / "sitecustomize.py").write_text(
        "import threading\n"
        "from srprov.transport.session import BaseSession\n"
        "whole = BaseSession._script\n"
        "def broken(self, put):\n"
        "    if not getattr(put, 'secret', ''):\n"
        "        return whole(self, put)\n"
        "    value = self._vault.content(put.secret).decode()\n"
        "    def beside():\n"
        "        raise ValueError('beside: ' + value)\n"
        "    threading.Thread(target=beside).start()\n"
        "    raise RuntimeError('a bug: ' + value, [value])\n"
        "BaseSession._script = broken\n"
    )
    stage.values["by-env"] = "canary-env-5b1f-changed"
    patched = stage.run("apply", str(stage.path), "--yes", code=1, PYTHONPATH=f"{ROOT}:{hook}")
    assert "RuntimeError" in patched.err and "ValueError: beside: ***" in patched.err
    assert "this is a bug in srprov" in patched.err
    for text in stage.said:
        assert seen_in(text) == [], text
    for path in stage.runs.rglob("*.json*"):
        assert seen_in(path.read_text()) == [], path


def test_the_files_a_changed_value_and_a_reboot(stage: Stage) -> None:
    """Read-only and in memory; a new value restarts nothing; after a reboot the plan names what is gone."""
    lab, container = stage.lab, "srprov.canary.reader"
    uses = [
        "by-env",
        {"source": "by-file", "target": "/etc/app/key", "mode": "0444"},
        {"source": "by-file", "target": "again"},
    ]
    stage.define(reader=busybox(robot="robot1", secrets=uses, restart="always", network="none"))
    stage.apply()
    inside = "stat -c '%a %u' /run/secrets/by-env /etc/app/key /run/secrets/again; echo x >/run/secrets/by-env"
    shown = lab.shell("robot1", "docker", "exec", container, "sh", "-c", inside, check=False)
    assert shown.out.split("\n")[:3] == ["400 0", "444 0", "400 0"]
    assert "Read-only file system" in shown.err
    placed = "cd /run/srprov/canary/secrets; stat -c '%a %n' . *; stat -f -c %T ."
    listing = ["700 .", "400 by-env", "400 by-file", "444 by-file@0444", "tmpfs", ""]
    assert lab.shell("robot1", "sh", "-c", placed).out.split("\n") == listing
    assert stage.run("plan", str(stage.path), "--json").json["steps"] == []

    before = lab.containers("robot1", running=True)
    stage.values.update({"by-env": "canary-env-5b1f-two", "by-file": "canary-file-77aa-two"})
    stage.write_values()
    plan = stage.run("plan", str(stage.path), "--json").json
    root = "robot1/secret:/run/srprov/canary/secrets"
    assert causes(plan) == dict.fromkeys(
        [f"{root}/by-env", f"{root}/by-file", f"{root}/by-file@0444"], "update: secret differs"
    )
    stage.apply()
    assert lab.containers("robot1", running=True) == before
    read = {path: stage.read("robot1", container, path) for path in ("/run/secrets/by-env", "/etc/app/key")}
    assert read == {"/run/secrets/by-env": "canary-env-5b1f-two", "/etc/app/key": "canary-file-77aa-two"}

    lab.srprov("lab", "restart", "robot1")
    gone = causes(stage.run("plan", str(stage.path), "--json").json)
    assert gone[f"{root}/by-env"] == "create: not there"
    stage.apply()
    assert stage.read("robot1", container, "/run/secrets/by-env") == "canary-env-5b1f-two"
    assert lab.inspect("robot1", container)["State"]["Status"] == "running"
    assert stage.run("plan", str(stage.path), "--json").json["steps"] == []
    stage.define(reader=busybox(robot="robot1", network="none"))
    stage.apply()
    assert lab.shell("robot1", "sh", "-c", "find /run/srprov -mindepth 1 -type d; true").out == ""
    assert [seen_in(text) for text in stage.said] == [[]] * len(stage.said)


def test_a_missing_value_stops_before_any_robot(stage: Stage) -> None:
    """Exit 5 at the line of the EDF, for plan and apply; `destroy` and `status` need no value."""
    stage.define(reader=busybox(robot="robot1", secrets=EVERY))
    stage.apply()
    (stage.folder / "by-file").unlink()
    for verb in ("plan", "apply"):
        more = ["--yes"] if verb == "apply" else []
        done = stage.run(verb, str(stage.path), *more, code=5)
        line = next(n for n, text in enumerate(stage.path.read_text().splitlines(), 1) if '"file"' in text)
        assert re.search(rf"experiment\.edf:{line}:\d+: error\[SRP-118\]: secret 'by-file': No such file", done.err), (
            done
        )
    stage.run("status", str(stage.path))
    stage.run("destroy", str(stage.path), "--yes")


def test_the_record_and_the_audit_log(stage: Stage) -> None:
    """Every apply and destroy leaves its folder, its name in the JSON, and one line on each robot that it changed."""
    lab, log = stage.lab, "/var/log/srprov.log"
    for robot in stage.robots:
        lab.shell(robot, "rm", "-f", log)
    stage.define(reader=busybox(robot="robot1", secrets=["by-env"]))
    other = stage.folder / "elsewhere"
    first = stage.apply("--json", "--runs", str(other)).json
    folder = Path(first["run"])
    assert folder.parent == other
    assert re.fullmatch(r"\d{8}T\d{6}Z-canary-[0-9a-f]{8}", folder.name)
    names = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    assert names == {
        "assignment.json", "environment.json", "events.jsonl", "facts.json", "plan.json", "plan.txt", "probe.json",
        "result.json", "inputs/experiment.edf", "inputs/inventory.yml", "rendered/robot1.yml", "rendered/robot2.yml",
    }  # fmt: skip
    assert {stat.S_IMODE(path.stat().st_mode) for path in folder.rglob("*")} == {0o600, 0o700}
    assert json.loads((folder / "result.json").read_text()) == first
    assert json.loads((folder / "assignment.json").read_text())["assignment"] == {"reader": "robot1"}
    assert set(json.loads((folder / "facts.json").read_text())["robots"]) == set(stage.robots)
    outcomes = [json.loads(line)["outcome"] for line in (folder / "events.jsonl").read_text().splitlines()]
    assert outcomes.count("changed") == first["changed"]

    again = stage.apply("--json").json
    assert Path(again["run"]).parent == stage.runs and again["steps"] == []
    gone = stage.run("destroy", str(stage.path), "--yes", "--json").json
    for robot in stage.robots:  # the second one keeps the placement record only
        lines = lab.shell(robot, "cat", log).out.splitlines()
        assert len(lines) == 2, "a run that changed nothing leaves no line"
        for line, run in zip(lines, (first, gone), strict=True):
            mine = sum(step["id"].startswith(f"{robot}/") for step in run["steps"])
            assert f" run={Path(run['run']).name} by=" in line
            assert mine and line.endswith(f"instance=canary changed={mine} failed=0")
        assert " verb=apply " in lines[0] and " verb=destroy " in lines[1]
        assert lab.shell(robot, "stat", "-c", "%a", log).out == "640\n"

    lab.shell("robot1", "sh", "-c", f"rm -f {log}; mkdir {log}")
    unaudited = stage.apply("--json", "--runs", "/proc/no-such-place")
    assert unaudited.json["run"] is None
    assert "warning: the record of this run is not complete: /proc/no-such-place" in unaudited.err
    assert "warning: robot1 has no audit line" in unaudited.err
    lab.shell("robot1", "rmdir", log)


def typed(lab: Lab, *arguments: str, answer: str) -> tuple[int, str]:
    """Run srprov on a terminal of its own and type an answer at its question; give exit code and what it showed."""
    pid, terminal = pty.fork()
    if pid == 0:
        os.chdir(lab.folder)
        os.environ["PYTHONPATH"] = str(ROOT)
        os.execv(sys.executable, [sys.executable, "-m", "srprov", *arguments])
    shown, told, until = b"", False, time.monotonic() + 120
    while time.monotonic() < until:
        if select.select([terminal], [], [], 0.2)[0]:
            try:
                piece = os.read(terminal, 4096)
            except OSError:
                break
            if not piece:
                break
            shown += piece
        if not told and shown.rstrip().endswith(b"sudo password:"):
            os.write(terminal, answer.encode() + b"\n")
            told = True
    os.close(terminal)
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), shown.decode()


def test_sudo_with_a_password(lab: Lab, tmp_path: Path) -> None:
    """From the inventory or typed: the robot is managed by a user who needs it, and the password is in no process."""
    password = "canary-sudo-4711"
    spec = tmp_path / "spec.yml"
    spec.write_text(json.dumps({"robots": {"robot13": {"user": "robot", "sudo_password": password}}}))
    up = lab.srprov("lab", "up", "-n", "13", "--spec", str(spec))
    assert up.code == 0, up
    try:
        path = tmp_path / "e.edf"
        path.write_text(edf("sudo", {"a": busybox(robot="robot13")}))
        without = part_of_lab(lab, ["robot13"], tmp_path / "without.yml")
        extra = {"robot13": {"ansible_become_password": password}}
        given = part_of_lab(lab, ["robot13"], tmp_path / "with.yml", **extra)
        wrong = part_of_lab(
            lab, ["robot13"], tmp_path / "wrong.yml", robot13={"ansible_become_password": "canary-wrong"}
        )
        assert "password is required" in lab.srprov("facts", "-i", without).err
        refused = lab.srprov("facts", "-i", wrong)
        assert "sudo does not accept the password" in refused.err and "canary-wrong" not in refused.err
        assert lab.srprov("facts", "-i", without, "-K").code == 9, "there is no terminal to ask on"
        with sampled(password):
            done = lab.srprov(
                "apply", str(path), "-i", given, "--yes", "--settle", "0", "--runs", str(tmp_path / "runs")
            )
            assert done.code == 0, done
            code, shown = typed(lab, "status", str(path), "-i", without, "-K", answer=password)
        assert code == 0 and "Up " in shown, shown
        recorded = "".join(each.read_text() for each in (tmp_path / "runs").rglob("*") if each.is_file())
        assert password not in str(done) + shown + recorded
        assert lab.srprov("destroy", str(path), "-i", given, "--yes", "--runs", str(tmp_path / "runs")).code == 0
    finally:
        spec.write_text(json.dumps({"count": 13}))
        assert lab.srprov("lab", "up", "--spec", str(spec)).code == 0
