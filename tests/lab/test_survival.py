"""An apply that is killed, cut off or loses an engine in the middle: the next one ends as if nothing had been.

A few moments of it; `make soak` takes every one.
"""

from __future__ import annotations

import subprocess
from collections.abc import Iterator

import pytest

from tests.lab.conftest import Lab
from tests.lab.looks import wait_until
from tests.lab.survival import Survivor, counted, kill, prepare

pytestmark = pytest.mark.lab

THIRDS = (0.2, 0.5, 0.8)


@pytest.fixture(scope="module")
def prepared(lab_of_module: Lab, tmp_path_factory: pytest.TempPathFactory) -> Survivor:
    """Give the experiment with what an undisturbed apply of it leaves; the robots are empty."""
    return prepare(lab_of_module, tmp_path_factory.mktemp("survive"))


@pytest.fixture
def survivor(prepared: Survivor) -> Iterator[Survivor]:
    """Give it, and empty the robots afterwards: whatever state a test left, `destroy` takes it away."""
    yield prepared
    prepared.clear()


@pytest.mark.parametrize("part", THIRDS)
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


def wait_for_engine(lab: Lab, robot: str) -> None:
    """Wait until the robot's dockerd, which its supervisor starts again, answers."""
    wait_until(
        lambda: lab.shell(robot, "docker", "version", check=False).code == 0, 30, f"the engine of {robot} is back"
    )


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
