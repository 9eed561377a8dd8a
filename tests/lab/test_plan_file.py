"""Plans that are kept: done as they stand, refused when a robot moved; and planning, which changes nothing."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from srprov import data
from tests.lab.conftest import NOTHING, Lab, busybox, edf, part_of_lab

pytestmark = pytest.mark.lab

ROBOTS = ("robot1", "robot2")
STATE = (
    "docker ps -aq --no-trunc; docker network ls -q; docker volume ls -q; docker images -q | sort; ip -br link; "
    "iptables-save -t nat | grep -v '^[#:]'; "
    "find /var/lib/srprov /run/srprov /tmp /root /etc -type f 2>/dev/null | sort"
)


@pytest.fixture
def trial(lab: Lab, tmp_path: Path) -> tuple[Lab, str, str]:
    """Give the lab, an inventory of two robots, and an EDF with a service on each."""
    path = tmp_path / "experiment.edf"
    services: dict[str, Any] = {"one": busybox(robot="robot1"), "two": busybox(robot="robot2")}
    path.write_text(edf("kept", services), encoding="utf-8")
    return lab, part_of_lab(lab, ROBOTS, tmp_path / "lab.yml"), str(path)


def test_a_plan_file_is_done_once_and_then_stale(trial: tuple[Lab, str, str], tmp_path: Path) -> None:
    """The file's steps are what is done; a second time the robots are not as the plan found them: exit 6."""
    lab, inventory, path = trial
    file = tmp_path / "plan.json"
    assert lab.srprov("plan", path, "-i", inventory, "-o", str(file)).code == 0
    steps = {f"{step['robot']}/{step['module']}:{step['name']}" for step in json.loads(file.read_text())["steps"]}

    first = lab.srprov("apply", str(file), "-i", inventory, "--yes", "--json", "--settle", "0")

    assert first.code == 0, first
    assert {step["id"] for step in first.json["steps"] if step["outcome"] == "changed"} == steps
    assert set(lab.containers("robot1", running=True)) == {"srprov.kept.one"}
    assert lab.srprov("plan", path, "-i", inventory, "--detailed-exitcode").code == 0
    before = lab.everywhere(ROBOTS)

    second = lab.srprov("apply", str(file), "-i", inventory, "--yes")

    assert second.code == 6, second
    assert "robot2" in second.err and "container:srprov.kept.two" in second.err
    assert lab.everywhere(ROBOTS) == before


def test_a_robot_that_moved_is_named_and_no_other_is_touched(trial: tuple[Lab, str, str], tmp_path: Path) -> None:
    """One network made by hand between plan and apply is enough: 6 with robot and what moved, and nothing is there."""
    lab, inventory, path = trial
    file = tmp_path / "plan.json"
    assert lab.srprov("plan", path, "-i", inventory, "-o", str(file)).code == 0
    lab.shell("robot2", "docker", "network", "create", "--label", "srprov.instance=kept", "srprov.kept")

    refused = lab.srprov("apply", str(file), "-i", inventory, "--yes")

    assert refused.code == 6, refused
    assert "robot2: resources network:srprov.kept: was not there" in refused.err
    assert "robot1" not in refused.err.split("robots changed", 1)[1].split("plan again", 1)[0]
    assert lab.leftovers("robot1") == NOTHING


def test_a_plan_file_with_other_bytes_is_refused(trial: tuple[Lab, str, str], tmp_path: Path) -> None:
    """It is no plan of this controller any more: nothing is done of an instance that it has made before."""
    lab, inventory, path = trial
    file = tmp_path / "plan.json"
    assert lab.srprov("plan", path, "-i", inventory, "-o", str(file)).code == 0
    document = json.loads(file.read_text())
    link = next(step for step in document["steps"] if step["module"] == "vxlan")
    link["commands"][0]["run"] += "\ntouch /tmp/not-planned"
    file.write_text(json.dumps(document, indent=2) + "\n")

    done = lab.srprov("apply", str(file), "-i", inventory, "--yes", "--settle", "0")

    assert done.code == 9, done
    assert "this plan was not written on this controller, and would " in done.err
    assert lab.leftovers(link["robot"]) == NOTHING
    assert lab.shell(link["robot"], "test", "-e", "/tmp/not-planned", check=False).code == 1


def test_planning_changes_nothing(trial: tuple[Lab, str, str]) -> None:
    """Before, between and after plans a robot is the same, and Docker has nothing to tell."""
    lab, inventory, path = trial
    since = lab.shell("robot1", "date", "+%s.%N").out.strip()
    before = [lab.shell(robot, "sh", "-c", STATE).out for robot in ROBOTS]

    for form in ("text", "json", "markdown"):
        assert lab.srprov("plan", path, "-i", inventory, "--format", form).code == 0

    assert [lab.shell(robot, "sh", "-c", STATE).out for robot in ROBOTS] == before
    until = lab.shell("robot1", "date", "+%s.%N").out.strip()
    for robot in ROBOTS:
        assert lab.shell(robot, "docker", "events", "--since", since, "--until", until).out == ""


def test_doctor_finds_the_labs_robots_well(trial: tuple[Lab, str, str]) -> None:
    """Nothing that is needed is missing, and every check has a verdict."""
    lab, inventory, _ = trial
    done = lab.srprov("doctor", "-i", inventory, "--json")

    assert done.code == 0, done
    assert set(done.json["robots"]) == set(ROBOTS)
    assert list(Draft202012Validator(data.schema("doctor")).iter_errors(done.json)) == []
    for checks in done.json["robots"].values():
        assert len(checks) >= 10
        assert [check for check in checks if check["verdict"] == "failed"] == []


def test_doctor_warns_of_a_program_that_asks_on_every_link(trial: tuple[Lab, str, str]) -> None:
    """A process of the robot's own with the name of one is told; in a container's network it is not."""
    lab, inventory, _ = trial
    script = "ln -s /bin/sleep /run/$2; $1 setsid /run/$2 600 </dev/null >/dev/null 2>&1 & sleep 0.2"
    lab.shell("robot1", "sh", "-c", script, "sh", "", "avahi-daemon")
    lab.shell("robot2", "sh", "-c", script, "sh", "unshare --net", "avahi-daemon")
    try:
        done = lab.srprov("doctor", "-i", inventory, "--json")
    finally:
        for robot in ROBOTS:
            lab.shell(robot, "sh", "-c", "kill $(pidof avahi-daemon); rm /run/avahi-daemon")

    assert done.code == 0, done
    verdicts = {
        robot: [check["verdict"] for check in checks if check["check"] == "avahi"]
        for robot, checks in done.json["robots"].items()
    }
    assert verdicts == {"robot1": ["warning"], "robot2": ["ok"]}
