"""Data of services: it stays where it is, is moved when the user says so, and belongs to who made it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.lab.conftest import ROOT, Done, Lab, busybox, edf, part_of_lab
from tests.lab.survival import counted

pytestmark = pytest.mark.lab

ROBOTS = ["robot1", "robot2"]
VOLUME = "srprov.data.log"
FILL = r"""
cd "$1" && printf 'first\n' > plain && chmod 0640 plain && chown 1234:4321 plain && ln plain hard && mkfifo pipe
mkdir -p deep/empty && chmod 2750 deep && ln -s ../plain deep/link && ln -s /nowhere dangling
touch -d '2001-02-03T04:05:06.789' plain && truncate -s 50M sparse && printf 'end' >> sparse
printf 'x' | dd of=sparse bs=1 seek=1000000 conv=notrunc 2>/dev/null
head -c 3000000 /dev/urandom > 'name with
a line feed' && chown 65534 . && chmod 0711 .
"""
_SHOW = r"""
cd "$1" && find . -printf '%y %m %U:%G %T@ %n %l %p\0' | sort -z | tr '\0' '|' && find . -type f -print0 | sort -z |
xargs -0 sha256sum && du -s -B1 . | awk '{print ($1 < 20000000) ? "sparse" : "not sparse"}'
"""
"""All that a tar should keep, by other programs than tar; the size on disk tells that holes stayed holes."""


class Home:
    """One experiment whose `web` has data, on two robots."""

    def __init__(self, lab: Lab, folder: Path) -> None:
        self.lab, self.folder = lab, folder
        self.state = folder / "state"
        self.inventory = part_of_lab(lab, ROBOTS, folder / "lab.yml")
        self.path = folder / "data.edf"

    def write(self, robot: str = "", path: Path | None = None, **more: Any) -> str:
        """Write the EDF, with `web` pinned or not."""
        pin = {"robot": robot} if robot else {}
        target = path or self.path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(edf("data", {"web": busybox(volumes=["log:/log"], **pin, **more)}), encoding="utf-8")
        return str(target)

    def run(self, verb: str, file: str, *more: str, **env: str) -> Done:
        done = self.lab.srprov(verb, file, "-i", self.inventory, *more, env={"XDG_STATE_HOME": str(self.state), **env})
        return done

    def apply(self, file: str, *more: str) -> Done:
        return self.run("apply", file, "--yes", "--settle", "0", *more)

    def place(self, robot: str) -> str:
        """Return where the data is on a robot, by Docker's word; empty when there is none."""
        asked = self.lab.shell(robot, "docker", "volume", "inspect", "-f", "{{.Mountpoint}}", VOLUME, check=False)
        return asked.out.strip() if asked.code == 0 else ""

    def show(self, robot: str) -> str:
        return self.lab.shell(robot, "sh", "-ec", _SHOW, "sh", self.place(robot)).out

    def running(self) -> list[str]:
        return [robot for robot in ROBOTS if "srprov.data.web" in self.lab.containers(robot, running=True)]

    def ends(self) -> list[str]:
        """Return the robot that has the data, and the other one."""
        return sorted(ROBOTS, key=lambda robot: not self.place(robot))

    def volumes(self, robot: str) -> list[str]:
        return self.lab.shell(robot, "docker", "volume", "ls", "-q").out.split()


@pytest.fixture(scope="module")
def home(lab_of_module: Lab, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Home]:
    """Give the experiment with data on robot1, where it begins; the tests share it. Afterwards the robots are empty."""
    made = Home(lab_of_module, tmp_path_factory.mktemp("data"))
    up = made.apply(made.write("robot1"))
    assert up.code == 0, up
    made.lab.shell("robot1", "sh", "-ec", FILL, "sh", made.place("robot1"))
    yield made
    gone = made.lab.srprov("destroy", "--instance", "data", "-i", made.inventory, "--yes", "--volumes")
    assert gone.code == 0, gone
    assert [made.volumes(robot) for robot in ROBOTS] == [[], []]


def test_data_belongs_to_who_made_it(home: Home, tmp_path: Path) -> None:
    """A same-named EDF elsewhere with a forged git source gets 9 until --adopt; so does a lost state folder, once."""
    gone = home.run("destroy", str(home.path), "--yes")
    assert gone.code == 0, gone
    before = home.show("robot1")
    labels = json.loads(home.lab.shell("robot1", "docker", "volume", "inspect", VOLUME).out)[0]["Labels"]

    stranger = tmp_path / "stranger"
    config = stranger / ".git" / "config"
    config.parent.mkdir(parents=True)
    config.write_text(f'[remote "origin"]\n\turl = {labels["srprov.source"].partition("#")[0]}\n', encoding="utf-8")
    theirs = home.write("robot1", stranger / "data.edf")
    for verb, *more in (("apply",), ("destroy", "--volumes")):
        refused = home.run(verb, theirs, "--yes", *more)
        assert refused.code == 9 and f"{VOLUME} on robot1" in refused.err and "--adopt" in refused.err, refused
    assert (home.running(), home.show("robot1")) == ([], before)

    plan = home.folder / "plan.json"
    mine = home.write("robot1")
    made = home.run("plan", mine, "-o", str(plan))
    assert made.code == 0, made
    (token,) = [json.loads(one.read_text())["token"] for one in (home.state / "srprov" / "owners").glob("*.json")]
    kept = [one for one in home.state.rglob("*") if one.is_file() and "owners" not in one.parts]
    assert not [one for one in (plan, *kept) if token.encode() in one.read_bytes()], "it is in no plan and no record"
    assert token not in json.dumps(labels), "nor on a robot"
    elsewhere = home.run("apply", str(plan), "--yes", XDG_STATE_HOME=str(tmp_path / "other"))
    assert elsewhere.code == 9 and home.running() == [], elsewhere

    os.rename(home.state, tmp_path / "lost")
    lost = home.apply(mine)
    assert lost.code == 9, lost
    adopted = home.apply(mine, "--adopt")
    assert (adopted.code, home.running()) == (0, ["robot1"]), adopted
    once = home.apply(mine)
    assert once.code == 0 and "Nothing to do" in once.out, once
    assert home.show("robot1") == before


def kill_at(home: Home, file: str, kind: str, count: int, of: str = "", then_s: float = 0.0) -> int:
    """Apply with `--data move`, and SIGKILL it some time after so many events have been; return its exit code."""
    events = home.folder / "events.jsonl"
    events.unlink(missing_ok=True)
    words = ["apply", file, "-i", home.inventory, "--yes", "--settle", "0", "--data", "move", "--events", str(events)]
    env = {**os.environ, "XDG_STATE_HOME": str(home.state), "PYTHONPATH": str(ROOT), "SRPROV_HEARTBEAT": "1,10,15"}
    run = subprocess.Popen(
        [sys.executable, "-m", "srprov", *words], env=env, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    until = time.monotonic() + 300
    while run.poll() is None and counted(events, kind, of) < count:
        assert time.monotonic() < until
        time.sleep(0.002)
    time.sleep(then_s)
    run.kill()
    return run.wait()


def test_data_is_moved_whole_also_when_the_move_was_killed_in_the_middle(home: Home) -> None:
    """Owner, mode, times, links, holes, empty folders, a pipe: as other programs than tar see them; then it is gone."""
    before = home.show(home.ends()[0])
    source, target = home.ends()
    file = home.write(target)
    assert kill_at(home, file, "progress", 1) == -9
    assert home.volumes(source) == [VOLUME] and home.show(source) == before, "the source is whole"
    plan = str(home.folder / "move.json")
    kept = home.run("plan", file, "--data", "move", "-o", plan)
    assert kept.code == 0, kept
    done = home.apply(plan, "--lock-wait", "30")
    assert (done.code, home.running()) == (0, [target]), done
    assert f"! data of web ({VOLUME}) is copied from {source} to {target}" in done.out
    assert home.show(target) == before
    assert (home.volumes(source), home.volumes(target)) == ([], [VOLUME])
    again = home.apply(file, "--data", "move", "--json")
    assert (again.code, again.json["changed"], again.json["steps"]) == (0, 0, []), again


MOMENTS = [
    *(("start", count, "", 0.0) for count in range(1, 12)),
    *(("end", count, "", 0.0) for count in range(1, 12)),
    *(("start", 1, "{target}/volume", 0.06 * count) for count in range(20)),
]
"""The beginning and end of every step, and moments inside of the one that copies: seven commands, of which one is long.

Beyond the last of them, nothing is killed.
"""


@pytest.mark.soak
@pytest.mark.timeout(3000)
def test_a_move_that_is_killed_at_every_step_loses_nothing(home: Home) -> None:
    """SIGKILL at every step and inside of the copy, to and fro: each time the next apply ends equal."""
    robots = home.ends()
    before = home.show(robots[0])
    killed: list[int] = []
    for kind, count, of, then_s in MOMENTS:
        source, target = robots
        file, moment = home.write(target), f"{kind} {count} {of} {then_s:.2f} s later"
        end = kill_at(home, file, kind, count, of.format(target=target), then_s)
        seen = {robot: home.show(robot) for robot in ROBOTS if VOLUME in home.volumes(robot)}
        assert before in seen.values(), f"{moment}: the data is whole somewhere"
        done = home.apply(file, "--data", "move", "--lock-wait", "30")
        killed.append(end)
        assert (done.code, home.running()) == (0, [target]), f"{moment}: {done}"
        assert home.show(target) == before, f"{moment}, exit {end}"
        assert (home.volumes(source), home.volumes(target)) == ([], [VOLUME]), moment
        robots.reverse()
    assert killed.count(-9) > len(MOMENTS) // 2, killed


def test_a_service_stays_where_its_data_is_until_the_user_says_what_becomes_of_it(home: Home) -> None:
    """Neither --reassign nor a pin moves it silently; `leave` keeps the data and says where; then it is listed."""
    here, there = home.ends()
    free = home.write(cost=90)
    done = home.apply(free, "--reassign")
    assert (done.code, home.running()) == (0, [here]), done
    gone = home.run("destroy", free, "--yes")
    assert gone.code == 0, gone
    assert f"data stays: {VOLUME} on {here} (" in gone.err and "MiB, " in gone.err and " old)" in gone.err
    nothing = home.run("status", free)
    assert f"data is kept: {VOLUME} on {here}" in nothing.out and "missing" in nothing.out, nothing
    doctor = home.lab.srprov("doctor", "-i", home.inventory)
    assert f"data is kept: {VOLUME} on {here} (" in doctor.out and f"--limit {here} removes it" in doctor.out, doctor
    listed = home.run("status", free, "--volumes", "--json").json["volumes"]
    assert [(row["volume"], row["robot"], row["used"]) for row in listed] == [(VOLUME, here, False)]
    assert 2_900_000 < listed[0]["bytes"] < 20_000_000
    before = home.show(here)
    again = home.apply(free)
    assert (again.code, home.running()) == (0, [here]), again
    assert home.show(here) == before

    pinned = home.write(there)
    refused = home.apply(pinned)
    assert f"! data of web stays on {here} ({VOLUME})" in refused.out, refused
    assert (refused.code, home.running()) == (9, [here]), refused
    assert "--data move" in refused.err and "--data leave" in refused.err
    kept = home.run("plan", pinned, "-o", str(home.folder / "refused.json"))
    assert kept.code == 9 and not (home.folder / "refused.json").exists(), kept
    left = home.apply(pinned, "--data", "leave")
    assert (left.code, home.running()) == (0, [there]), left
    assert home.show(here) == before
    then = home.apply(pinned)
    assert then.code == 0 and f"note: data volume {VOLUME} on {here} is kept, and no service uses it there" in then.out
    assert "Nothing to do" in then.out, then
