"""How often a robot is asked: counted, since a count is the same on every machine and a time is not."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.lab.conftest import Lab, busybox, edf, part_of_lab

pytestmark = pytest.mark.lab

ROBOTS = ("robot1", "robot2", "robot3")
NOTHING_TO_DO = 1
FRESH = 9
PER_CONTAINER = 2
PROBE = 3
"""The program, who is where, and what it says."""


@pytest.mark.parametrize("pinned", [True, False])
def test_round_trips(lab: Lab, tmp_path: Path, pinned: bool) -> None:
    """One connection per robot and run; a budget of waits for nothing to do, for a fresh apply, and per container.

    To choose robots takes no more of them than to be told.
    """
    path = tmp_path / "experiment.edf"
    places = {"a": "robot1", "b": "robot2", "c": "robot3", "d": "robot3"}
    services = {name: busybox(robot=robot) if pinned else busybox() for name, robot in places.items()}
    path.write_text(edf(f"budget-{pinned}".lower(), services, placement={"slots_per_robot": 2}), encoding="utf-8")
    inventory = part_of_lab(lab, ROBOTS, tmp_path / "lab.yml")
    for robot in ROBOTS:
        lab.shell(robot, "docker", "pull", "-q", "busybox")

    fresh = lab.srprov("apply", str(path), "-i", inventory, "--yes", "--json", "--settle", "0")
    again = lab.srprov("apply", str(path), "-i", inventory, "--yes", "--json", "--settle", "0")

    assert (fresh.code, again.code) == (0, 0), (fresh, again)
    assert fresh.json["changed"] > 0 and again.json["changed"] == 0
    for report in (fresh.json, again.json):
        assert {robot["connections"] for robot in report["robots"].values()} == {1}
    asked = {robot: one["round_trips"] for robot, one in again.json["robots"].items()}
    assert max(asked.values()) <= NOTHING_TO_DO, asked
    asked = {robot: one["round_trips"] for robot, one in fresh.json["robots"].items()}
    allowed = {robot: FRESH + PROBE + PER_CONTAINER * len(lab.containers(robot, running=True)) for robot in ROBOTS}
    assert all(asked[robot] <= allowed[robot] for robot in ROBOTS), (asked, allowed)
