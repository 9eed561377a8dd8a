"""A part of an experiment, more of each container, and all instances at once: what Docker's own word makes of it."""

from __future__ import annotations

import datetime as dt
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import Any

import pytest

from tests.lab.conftest import NOTHING, Lab, busybox, edf, part_of_lab
from tests.lab.looks import reached, wait_until

pytestmark = pytest.mark.lab

ROBOTS = ("robot1", "robot2")
HOW = ("--yes", "--settle", "0")


def words(lab: Lab, path: Path, services: dict[str, dict[str, Any]]) -> tuple[str, str, str]:
    """Write an experiment that is called as its file is; give its EDF and the inventory as arguments."""
    path.write_text(edf(path.stem, services, placement={"slots_per_robot": 4}), encoding="utf-8")
    return str(path), "-i", part_of_lab(lab, ROBOTS, path.parent / "lab.yml")


def identities(lab: Lab, name: str, services: dict[str, str]) -> dict[str, tuple[str, str, str]]:
    """Give service -> id, start and variable RATE of its container, for services with their robots."""
    found = {service: lab.inspect(robot, f"srprov.{name}.{service}") for service, robot in services.items()}
    rates = {service: [one for one in seen["Config"]["Env"] if "RATE=" in one] for service, seen in found.items()}
    return {
        service: (seen["Id"], seen["State"]["StartedAt"], "".join(rates[service])) for service, seen in found.items()
    }


def test_a_target_is_changed_and_the_others_are_left(lab: Lab, tmp_path: Path) -> None:
    """Of a change in all services one is made; a new target is found by containers that nobody restarts."""
    path, homes = tmp_path / "part.edf", {"a": "robot1", "b": "robot2", "c": "robot2"}

    def written(rate: str, *more: str) -> tuple[str, str, str]:
        services = {**homes, **dict.fromkeys(more, "robot1")}
        return words(lab, path, {one: busybox(robot=at, environment={"RATE": rate}) for one, at in services.items()})

    try:
        assert lab.srprov("apply", *written("2"), *HOW).code == 0
        before = identities(lab, "part", homes)
        change = written("4", "late")
        planned = lab.srprov("plan", *change, "--target", "b", "--json")
        touched = [one["name"] for one in planned.json["steps"] if one["module"] == "container"]
        assert touched == ["srprov.part.b"], planned
        assert any("a, c, late" in note for note in planned.json["notes"]), planned

        assert lab.srprov("apply", *change, *HOW, "--target", "b").code == 0
        after = identities(lab, "part", homes)
        assert (after["a"], after["c"]) == (before["a"], before["c"])
        assert (before["b"][2], after["b"][2]) == ("RATE=2", "RATE=4") and after["b"][0] != before["b"][0]
        assert "srprov.part.late" not in lab.containers("robot1")

        assert lab.srprov("apply", *change, *HOW, "--target", "late").code == 0
        assert identities(lab, "part", homes) == after
        assert reached(lab, "robot2", "srprov.part.c", ["late"]) == {"late"}
        restarted = lab.srprov("restart", *change, "b", "--yes")
        assert restarted.code == 0, restarted
        again = identities(lab, "part", homes)
        assert [one for one in homes if again[one] != after[one]] == ["b"] and again["b"][0] == after["b"][0]

        assert lab.srprov("apply", *change, *HOW).code == 0
        whole = identities(lab, "part", homes)
        assert {rate for _, _, rate in whole.values()} == {"RATE=4"} and whole["b"] == again["b"]
    finally:
        assert lab.srprov("destroy", str(path), "-i", str(tmp_path / "lab.yml"), "--yes").code == 0


def test_wide_says_what_docker_says(lab: Lab, tmp_path: Path) -> None:
    """Exit code, restarts, times, ports and mounts of one that runs, one that failed and one that is started anew."""
    services = {
        "web": busybox(robot="robot1", ports=["8080:80", "127.0.0.1:8053:53/udp"], volumes=["log:/log"]),
        "failed": busybox("sh", "-c", "sleep 4; exit 7", robot="robot2", job=True),
        "weak": busybox("sh", "-c", "sleep 3; exit 1", robot="robot2", restart="on-failure:1"),
    }
    experiment = words(lab, tmp_path / "wide.edf", services)
    try:
        applied = lab.srprov("apply", *experiment, *HOW, "--allow", "restart-always")
        assert applied.code == 0, applied
        for name in ("failed", "weak"):
            wait_until(partial(ended, lab, f"srprov.wide.{name}"), 30, f"{name} has ended")
        seen = lab.srprov("status", *experiment, "--wide", "--json")
        rows = {row["service"]: (row["robot"], row["wide"]) for row in seen.json["services"]}
        assert rows.keys() == services.keys(), seen
        for service, (robot, wide) in rows.items():
            docker = lab.inspect(robot, f"srprov.wide.{service}")
            assert wide == as_docker_says(docker, wide["robot_address"]), service
            assert "inet " + wide["robot_address"] + "/" in lab.shell(robot, "ip", "-4", "address").out
        assert (rows["failed"][1]["exit_code"], rows["weak"][1]["exit_code"], rows["weak"][1]["restarts"]) == (7, 1, 1)

        text = lab.srprov("status", *experiment, "--wide").out
        (web,) = (line for line in text.splitlines() if " web " in line)
        for told in ("0.0.0.0:8080->80/tcp", "127.0.0.1:8053->53/udp", "srprov.wide.log:/log", "srprov.wide.web"):
            assert told in web, text
        (failed,) = (line for line in text.splitlines() if " failed " in line)
        assert f" 7 - {rows['failed'][1]['ended']}" in " ".join(failed.split()), text
    finally:
        assert lab.srprov("destroy", *experiment, "--yes", "--volumes").code == 0


def ended(lab: Lab, name: str) -> bool:
    """Return whether a container on robot2 has ended for good."""
    docker = lab.inspect("robot2", name)
    policy = docker["HostConfig"]["RestartPolicy"]["MaximumRetryCount"]
    return docker["State"]["Status"] == "exited" and docker["RestartCount"] >= policy


def as_docker_says(docker: dict[str, Any], address: str) -> dict[str, Any]:
    """Give what `--wide` must say of a container that `docker inspect` shows."""
    state, ports = docker["State"], docker["NetworkSettings"]["Ports"] or {}
    over = state["Status"] == "exited"
    bound = [(name.split("/"), end) for name, ends in sorted(ports.items()) for end in ends or ()]
    return {
        "robot_address": address,
        "container": docker["Name"][1:],
        "state": state["Status"],
        "exit_code": state["ExitCode"] if over else None,
        "restarts": docker["RestartCount"],
        "started": second(state["StartedAt"]),
        "ended": second(state["FinishedAt"]) if over else None,
        "ports": [
            {"port": int(port), "protocol": form, "robot_port": int(end["HostPort"]), "robot_address": end["HostIp"]}
            for (port, form), end in bound
        ],
        "volumes": [
            {
                "kind": one["Type"], "source": one["Name"] if one["Type"] == "volume" else one["Source"],
                "target": one["Destination"], "read_only": not one["RW"],
            }
            for one in sorted(docker["Mounts"], key=itemgetter("Destination"))
        ],
    }  # fmt: skip


def second(moment: str) -> str:
    """Give a time of Docker's to the second."""
    return dt.datetime.fromisoformat(moment[:19]).strftime("%Y-%m-%dT%H:%M:%SZ")


def test_all_instances_are_listed_and_go_and_what_is_not_ours_stays(lab: Lab, tmp_path: Path) -> None:
    """With a file those that it made; without, everybody's. Data and containers that somebody made by hand stay."""
    mine = words(lab, tmp_path / "mine.edf", {"a": busybox(robot="robot1"), "b": busybox(robot="robot2")})
    theirs = words(lab, tmp_path / "theirs.edf", {"a": busybox(robot="robot2", volumes=["log:/log"])})
    every = ("destroy", *mine[1:], "--all-instances")
    for more in (mine, (*mine, "--instance", "second"), theirs):
        assert lab.srprov("apply", *more, *HOW).code == 0
    image = lab.inspect("robot1", "srprov.mine.a")["Image"]
    lab.shell("robot1", "docker", "run", "--detach", "--name", "by-hand", image, "sleep", "86400")
    there = lab.everywhere(ROBOTS)
    assert sorted(there["robot2"]) == ["srprov.mine.b", "srprov.second.b", "srprov.theirs.a"]

    asked = lab.srprov(*every)
    assert asked.code == 9 and "no terminal to ask on" in asked.err, asked
    refused = lab.srprov(*every, "--volumes", "--yes")
    assert refused.code == 9 and "remove data of whoever made it" in refused.err, refused
    assert lab.everywhere(ROBOTS) == there

    own = lab.srprov("destroy", *mine, "--all-instances", "--yes")
    assert own.code == 0 and "another file made theirs: left alone" in own.err, own
    assert [line.split()[0] for line in own.out.splitlines()[1:3]] == ["mine", "second"], own
    left = {"robot1": ["by-hand"], "robot2": ["srprov.theirs.a"]}
    now = lab.everywhere(ROBOTS)
    assert {robot: sorted(found) for robot, found in now.items()} == left
    assert all(now[robot][name] == there[robot][name] for robot, (name,) in left.items()), "the same containers"

    assert lab.srprov(*every, "--yes").code == 0
    assert {robot: sorted(found) for robot, found in lab.everywhere(ROBOTS).items()} == {
        "robot1": ["by-hand"],
        "robot2": [],
    }
    assert lab.leftovers("robot2")["volumes"] == ["srprov.theirs.log"], "data stays"
    assert lab.srprov(*every, "--yes", "--volumes", "--adopt").code == 0
    assert [lab.leftovers(robot) for robot in ROBOTS] == [NOTHING, NOTHING]
    assert "by-hand" in lab.containers("robot1", running=True)
