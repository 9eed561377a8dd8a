"""Locks on real robots: two controllers, killed controllers, cut networks. Each test has robots of its own.

SRPROV_RACES says how often two controllers race; `make soak` makes 50 of it.
"""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from srprov import data
from tests.lab.conftest import Lab, busybox, edf, part_of_lab
from tests.lab.looks import begin

pytestmark = pytest.mark.lab

RACES = int(os.environ.get("SRPROV_RACES", "1"))
HEARTBEAT = "1,8,12"
"""Seconds: beat, controller gives up, robot's end gives up."""
LOGINS = "grep -laE '^sshd(-session)?: (root|robot)' /proc/[0-9]*/cmdline 2>/dev/null; true"
OURS = "grep -la SRPROV_SESSION= /proc/[0-9]*/environ 2>/dev/null; true"


def free(lab: Lab, robot: str) -> bool:
    """Ask the kernel, not srprov."""
    done = lab.shell(robot, "sh", "-c", "test ! -e /run/srprov/lock || flock -n /run/srprov/lock true", check=False)
    assert done.code in (0, 1), done
    return done.code == 0


def wait_until(holds: Callable[[], bool], seconds: float) -> float:
    """Wait until it holds; give how long that took."""
    begun = time.monotonic()
    while not holds():
        assert time.monotonic() - begun < seconds, f"not within {seconds} s"
        time.sleep(0.1)
    return time.monotonic() - begun


def until_said(run: subprocess.Popen[str], words: str, seconds: float = 300) -> str:
    """Read stderr up to a line with these words; give all of it."""
    assert run.stderr is not None
    said, until = "", time.monotonic() + seconds
    while words not in said:
        line = run.stderr.readline()
        assert line, f"it ended with {run.wait()} before {words!r}:\n{said}"
        assert time.monotonic() < until, f"not within {seconds} s: {words!r}:\n{said}"
        said += line
    return said


def slow(path: Path, name: str, robots: Sequence[str], build_s: int) -> str:
    """Write an experiment, one robot of which builds for so long, or until `release`; return the EDF's path."""
    waits = f'timeout {build_s} sh -c "until test -e /go; do sleep 0.1; done" || true'
    lines = f"cdf: 1\nname: {name}\nbase: busybox\nrun: ['echo {name} {path.name}; {waits}']\n"
    (path / f"{name}.cdf").write_text(lines, encoding="utf-8")
    command = {"command": ["sleep", "86400"], "stop_signal": "SIGKILL"}
    services = {f"s{i}": {"cdf": f"{name}.cdf", "robot": robot, **command} for i, robot in enumerate(robots)}
    (path / f"{name}.edf").write_text(edf(name, services), encoding="utf-8")
    return str(path / f"{name}.edf")


def until_it_builds(lab: Lab, robots: Sequence[str]) -> tuple[str, str]:
    """Wait until a `slow` build runs on one of its robots; return that robot, and the build's container."""
    building: list[tuple[str, str]] = []
    until = time.monotonic() + 300
    while not building:
        assert time.monotonic() < until, f"nothing is built on {robots}"
        building = [(robot, one) for robot in robots for one in lab.containers(robot, running=True).values()]
    (only,) = building
    return only


def release(lab: Lab, robots: Sequence[str]) -> None:
    """Let a `slow` build end."""
    robot, build = until_it_builds(lab, robots)
    lab.shell(robot, "docker", "exec", build, "touch", "/go")


def nobody(lab: Lab, inventory: str) -> bool:
    """Ask srprov who holds its robots."""
    seen = lab.srprov("locks", "-i", inventory, "--json")
    assert seen.code == 0, seen
    return not any(seen.json["robots"].values())


@pytest.mark.parametrize("turn", range(RACES))
def test_race_exactly_one_acts(
    cleared: Lab, tmp_path: Path, record_property: Callable[[str, object], None], turn: int
) -> None:
    """Two controllers want overlapping robots at once: one acts and ends well, the other touches nothing (7)."""
    lab, parts = cleared, (["robot1", "robot2", "robot3"], ["robot2", "robot3", "robot1"])
    if turn % 2:
        parts = (["robot1", "robot3"], ["robot2", "robot3"])
    inventory = part_of_lab(lab, ["robot1", "robot2", "robot3"], tmp_path / "lab.yml")
    runs, wanted = [], []
    for name, robots in zip(("anna", "bob"), parts, strict=True):
        path = tmp_path / f"{name}.edf"
        services = {f"s{i}": busybox(robot=robot) for i, robot in enumerate(robots)}
        path.write_text(edf(name, services), encoding="utf-8")
        wanted.append({f"srprov.{name}.s{i}" for i in range(len(robots))})
        common = ("apply", str(path), "-i", inventory, "--yes", "--settle", "5")
        runs.append(begin(lab, *common, "--events", str(tmp_path / f"{name}.ndjson")))
    try:
        ends = [(run.communicate(timeout=120)[1], run.returncode) for run in runs]
    finally:
        for run in runs:
            run.kill()  # one that is stuck would hold the robots for good
    assert sorted(code for _, code in ends) == [0, 7], ends
    loser = 0 if ends[0][1] == 7 else 1
    record_property("winner", ("anna", "bob")[1 - loser])
    assert "is held by" in ends[loser][0] and f"apply {('bob', 'anna')[loser]}, since" in ends[loser][0]
    assert "--lock-wait" in ends[loser][0]
    acted = [json.loads(line) for line in (tmp_path / f"{('anna', 'bob')[loser]}.ndjson").read_text().splitlines()]
    assert not any(event["event"] in ("start", "end") for event in acted)
    there = {name for robot in ("robot1", "robot2", "robot3") for name in lab.containers(robot, running=True)}
    assert {name for name in there if name.startswith(("srprov.anna.", "srprov.bob."))} == wanted[1 - loser]
    assert nobody(lab, inventory)


@pytest.fixture
def cleared(lab_of_module: Lab) -> Iterator[Lab]:
    """Give the lab to a race, and take away what both want afterwards."""
    yield lab_of_module
    for name in ("anna", "bob"):
        gone = lab_of_module.srprov("destroy", "--instance", name, "-i", str(lab_of_module.inventory), "--yes")
        assert gone.code == 0, gone


def test_locks_tells_who_and_waiting_finds_the_work_done(lab_of_module: Lab, tmp_path: Path) -> None:
    """While one controller builds, `locks` names it, a second is refused, a third waits and has nothing to do."""
    lab, robots = lab_of_module, ["robot4", "robot5"]
    inventory = part_of_lab(lab, robots, tmp_path / "lab.yml")
    more = part_of_lab(lab, [*robots, "robot6"], tmp_path / "more.yml")
    path = slow(tmp_path, "slowly", robots, 60)
    common = ("apply", path, "-i", inventory, "--yes", "--settle", "0.5")
    first = begin(lab, *common)
    until_it_builds(lab, robots)

    seen = lab.srprov("locks", "-i", more, "--json")
    assert seen.code == 0, seen
    Draft202012Validator(data.schema("locks")).validate(seen.json)
    told: dict[str, Any] = seen.json["robots"]
    assert (sorted(told), told["robot6"], seen.json["unreachable"]) == ([*robots, "robot6"], None, {})
    for robot in robots:
        assert told[robot]["owner"].startswith("root@")
        assert (told[robot]["pid"], told[robot]["purpose"]) == (first.pid, "apply slowly")
        assert told[robot]["run"] == told["robot4"]["run"] != ""
        assert 0 <= told[robot]["age_s"] < 60 and told[robot]["since"].endswith(" UTC")
    table = lab.srprov("locks", "-i", more).out
    assert "apply slowly" in table and "robot4" in table and "robot6" not in table

    waits = begin(lab, *common, "--json", "--lock-wait", "120")
    refused = lab.srprov(*common)
    assert refused.code == 7, refused
    assert f"robot4 is held by {told['robot4']['owner']}, process {first.pid}: apply slowly, since" in refused.err

    impatient = begin(lab, *common, "--lock-wait", "120")
    until_said(impatient, "waiting up to")
    impatient.send_signal(signal.SIGTERM)
    begun = time.monotonic()
    _, err = impatient.communicate(timeout=120)
    assert impatient.returncode == 130 and "interrupted" in err, err
    assert time.monotonic() - begun < 60

    release(lab, robots)
    _, err = first.communicate(timeout=120)
    assert first.returncode == 0, err
    out, err = waits.communicate(timeout=120)
    assert waits.returncode == 0, err
    report = json.loads(out)
    assert (report["changed"], report["failed"], report["steps"]) == (0, 0, []), "it planned when the first was done"
    assert report["unchanged"] > 0
    assert "held by" in err and re.search("waiting up to 1(20|1[0-9]) s", err), "and what it took to ask is taken off"
    assert lab.srprov("locks", "-i", inventory).out == "nobody holds a robot\n"


def test_a_killed_controller_leaves_no_lock(lab_of_module: Lab, tmp_path: Path) -> None:
    """SIGKILL in the middle of a build: free within moments, nothing of it runs on, the next apply finishes."""
    lab, robots = lab_of_module, ["robot7", "robot8"]
    inventory = part_of_lab(lab, robots, tmp_path / "lab.yml")
    path = slow(tmp_path, "killed", robots, 6)
    common = ("apply", path, "-i", inventory, "--yes", "--settle", "0.5")
    run = begin(lab, *common)
    until_it_builds(lab, robots)
    assert not free(lab, "robot7")
    assert lab.shell("robot7", "sh", "-c", LOGINS).out != "", "the pattern sees what it shall see"
    run.send_signal(signal.SIGKILL)
    run.communicate(timeout=120)
    took_s = wait_until(lambda: all(free(lab, robot) for robot in robots), 60)
    assert took_s < 25, "long before a silent controller is given up"
    assert [lab.shell(robot, "sh", "-c", OURS).out for robot in robots] == ["", ""]
    assert nobody(lab, inventory)
    # Docker ends a build whose client is gone
    wait_until(lambda: not any(lab.containers(robot) for robot in robots), 60)

    again = lab.srprov(*common, "--json")
    assert again.code == 0, again
    third = lab.srprov(*common, "--json")
    assert (third.code, third.json["changed"]) == (0, 0)


def test_a_cut_network_leaves_no_lock(lab_of_module: Lab, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No packet goes through, and sshd notices nothing: the controller stops, then the robot frees itself."""
    lab, robots = lab_of_module, ["robot9", "robot10"]
    monkeypatch.setenv("SRPROV_HEARTBEAT", "1,5,8")  # both robots only wait, and answer at once
    # on one of them sudo stands between sshd and the lock's script
    inventory = part_of_lab(lab, robots, tmp_path / "lab.yml", robot10={"ansible_user": "robot"})
    path = slow(tmp_path, "cut", robots, 25)
    common = ("apply", path, "-i", inventory, "--yes", "--settle", "0.5")
    run = begin(lab, *common, "--json")
    until_it_builds(lab, robots)
    assert "" not in [lab.shell(robot, "sh", "-c", LOGINS).out for robot in robots]
    try:
        for robot in robots:
            done = lab.srprov("lab", "partition", robot)
            assert done.code == 0, done
        begun = time.monotonic()
        assert not free(lab, "robot10")
        out, err = run.communicate(timeout=120)
        assert time.monotonic() - begun < 60, err
        assert run.returncode == 4, err
        report = json.loads(out)
        assert report["unreachable"] == sorted(robots), err
        assert "lost contact" in err, err
        wait_until(lambda: all(free(lab, robot) for robot in robots), 90 - (time.monotonic() - begun))
        assert [lab.shell(robot, "sh", "-c", OURS).out for robot in robots] == ["", ""]
        # sshd has streams to the engine: a request that is late must find none
        assert [lab.shell(robot, "sh", "-c", LOGINS).out for robot in robots] == ["", ""]
    finally:
        for robot in robots:
            lab.srprov("lab", "heal", robot)
    slow(tmp_path, "cut", robots, 1)
    again = lab.srprov(*common, "--json")
    assert again.code == 0, again
    third = lab.srprov(*common, "--json")
    assert (third.code, third.json["changed"]) == (0, 0)


def test_ctrl_c_once_frees_all(lab_of_module: Lab, tmp_path: Path) -> None:
    """The running step ends, no other begins, the report is made, all locks are free; the next apply goes on."""
    lab, robots = lab_of_module, ["robot11", "robot12"]
    inventory = part_of_lab(lab, robots, tmp_path / "lab.yml")
    path = slow(tmp_path, "softly", robots, 60)
    common = ("apply", path, "-i", inventory, "--yes", "--settle", "0.5", "--json")
    run = begin(lab, *common)
    until_it_builds(lab, robots)
    run.send_signal(signal.SIGINT)
    with pytest.raises(subprocess.TimeoutExpired):  # it waits for the step
        run.wait(1)
    release(lab, robots)
    out, err = run.communicate(timeout=120)
    assert run.returncode == 130, err
    report = json.loads(out)
    ends = {step["outcome"] for step in report["steps"]}
    assert ends == {"changed", "not reached"}, report
    built = [step["id"] for step in report["steps"] if "image:" in step["id"] and step["outcome"] == "changed"]
    assert built, "the step that ran was to end"
    assert not any(lab.containers(robot) for robot in robots)
    assert all(free(lab, robot) for robot in robots)
    again = lab.srprov(*common)
    assert again.code == 0, again
    assert set(built).isdisjoint(step["id"] for step in again.json["steps"])
