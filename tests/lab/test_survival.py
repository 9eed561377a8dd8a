"""An apply that is killed, cut off or loses an engine in the middle: the next one ends as if nothing had been.

A few moments of it; `make soak` takes every one.
"""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.lab.conftest import NOTHING, Lab, busybox, edf, part_of_lab
from tests.lab.looks import begin, wait_until
from tests.lab.survival import Survivor, counted, kill, prepare, wait_for_engine

pytestmark = pytest.mark.lab

PARTS = (0.2, pytest.param(0.4, marks=pytest.mark.soak), 0.6)
"""Not later: on a busy machine the kill comes late, and the last step of each robot is on its way by then."""


@pytest.fixture(scope="module")
def prepared(lab_of_module: Lab, tmp_path_factory: pytest.TempPathFactory) -> Survivor:
    """Give the experiment with what an undisturbed apply of it leaves; the robots are empty."""
    return prepare(lab_of_module, tmp_path_factory.mktemp("survive"))


@pytest.fixture
def survivor(prepared: Survivor) -> Iterator[Survivor]:
    """Give it, and empty the robots afterwards: whatever state a test left, `destroy` takes it away."""
    yield prepared
    prepared.clear()


@pytest.mark.parametrize("part", PARTS)
def test_a_killed_apply_is_finished_by_the_next(survivor: Survivor, part: float) -> None:
    """SIGKILL after so many of its steps have ended: all robots end equal to an undisturbed run, and no lock stays."""
    count = max(1, round(part * survivor.steps))
    killed = survivor.disturb("end", count, kill)
    assert killed.code == -9, killed
    ended = counted(survivor.folder / "events.jsonl", "end")
    assert count <= ended < survivor.steps, "it was to be killed in the middle"
    again = survivor.assert_converges()
    assert 0 < again.json["changed"] < survivor.steps, "something was left to do, and what was done stayed"


def test_a_robot_that_is_cut_off_in_the_middle_is_finished_later(survivor: Survivor) -> None:
    """No packet goes to or from one robot: exit 4 names it, the others are done; healed, the next apply ends it."""
    lab, robot = survivor.lab, "robot2"

    def cut(_run: subprocess.Popen[str]) -> None:
        done = lab.srprov("lab", "partition", robot)
        assert done.code == 0, done

    try:
        off = survivor.disturb("start", 2, cut, f"{robot}/")
    finally:
        healed = lab.srprov("lab", "heal", robot)
    assert healed.code == 0, healed
    assert off.code == 4, off
    assert off.json["unreachable"] == [robot]
    assert f"unreachable: {robot}: lost contact" in off.err, off
    ends = {step["id"]: step["outcome"] for step in off.json["steps"]}
    elsewhere = {outcome for step, outcome in ends.items() if not step.startswith(f"{robot}/")}
    assert elsewhere == {"changed"}, off
    assert "unreachable" in ends.values()
    survivor.assert_converges()


def test_an_engine_that_crashes_in_the_middle_is_finished_later(survivor: Survivor) -> None:
    """dockerd of one robot gets SIGKILL while it starts a container: that robot's steps fail, the others are done."""
    lab, robot = survivor.lab, "robot2"

    def crash(_run: subprocess.Popen[str]) -> None:
        done = lab.srprov("lab", "kill", robot, "--docker")
        assert done.code == 0, done

    hit = survivor.disturb("start", 1, crash, f"{robot}/container:")
    assert hit.code in (3, 4), hit
    ends = {step["id"]: step for step in hit.json["steps"]}
    wrong = {step: one for step, one in ends.items() if one["outcome"] != "changed"}
    assert wrong and all(step.startswith(f"{robot}/") for step in wrong), hit
    assert all(one["message"] for one in wrong.values()), hit
    wait_for_engine(lab, robot)
    survivor.assert_converges()


def test_an_engine_that_dies_while_it_starts_a_container_is_finished_later(survivor: Survivor) -> None:
    """It leaves the container created, and a shim that it does not know: the next apply mends both."""
    lab, robot = survivor.lab, "robot2"
    hit = survivor.kill_engine_while_it_starts(robot, 0.2)
    assert hit.code in (3, 4), hit
    wait_for_engine(lab, robot)
    states = lab.shell(robot, "docker", "ps", "--all", "--format", "{{.State}}").out.split()
    assert states == ["created"], "the engine was to be killed before the start was done"
    again = survivor.assert_converges()
    assert any(step["id"].startswith(f"{robot}/container:") for step in again.json["steps"])


def test_what_a_killed_build_leaves_is_removed_by_whoever_comes_next(lab_of_module: Lab, tmp_path: Path) -> None:
    """Its container has no name of ours, only the mark: another experiment's plan names it, and destroy removes it."""
    lab, robot = lab_of_module, "robot5"
    (tmp_path / "long.cdf").write_text("cdf: 1\nname: long\nbase: busybox\nrun: [sleep 300]\n", encoding="utf-8")
    inventory = part_of_lab(lab, [robot], tmp_path / "lab.yml")
    path, other = tmp_path / "built.edf", tmp_path / "other.edf"
    path.write_text(edf("built", {"a": {"cdf": "long.cdf", "command": ["sleep", "9"]}}), encoding="utf-8")
    other.write_text(edf("other", {"a": busybox()}), encoding="utf-8")
    run = begin(lab, "apply", str(path), "-i", inventory, "--yes")
    built = ("docker", "ps", "--all", "--format", "{{.Names}}", "--filter", "label=srprov.instance=.build")
    running = (*built, "--filter", "status=running")
    named = wait_until(lambda: lab.shell(robot, *running).out.split(), 60, "the build runs a container")  # noqa: PLW0108 - asks again
    assert lab.srprov("lab", "kill", robot, "--docker").code == 0
    run.communicate(timeout=120)
    wait_for_engine(lab, robot)
    assert lab.shell(robot, *built).out.split() == named, "the engine itself forgets it"
    planned = lab.srprov("plan", str(other), "-i", inventory)
    assert f"{named[0]}" in planned.out and "left by a build that was cut off" in planned.out, planned
    gone = lab.srprov("destroy", str(path), "-i", inventory, "--yes", "--volumes")
    assert gone.code == 0, gone
    assert lab.leftovers(robot) == NOTHING
