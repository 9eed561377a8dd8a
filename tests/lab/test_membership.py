"""Robots join and services move while others talk: nobody else is restarted, and hardly anything is lost."""

from __future__ import annotations

import json
import math
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest

from srprov.lab import state
from tests.lab import talk
from tests.lab.conftest import Lab, busybox, edf, part_of_lab
from tests.lab.looks import address_of, reached, wait_until

pytestmark = pytest.mark.lab

MOST_S = 1.0
"""What others may be without an answer while somebody joins or moves."""
HOMES = {"left": "robot1", "right": "robot2", "web": "robot3"}
JOINED = {**HOMES, "new": "robot4"}
MOVED = {**JOINED, "web": "robot4"}
"""The web server moves to the robot of somebody who knows it; it says nothing unless it is asked."""
WEB = ("busybox", "httpd", "-f", "-p", "80", "-h", "/etc")


class Experiment:
    """One experiment on the first four robots."""

    def __init__(self, lab: Lab, folder: Path) -> None:
        self.lab, self.path = lab, folder / "experiment.edf"
        self.inventory = part_of_lab(lab, ["robot1", "robot2", "robot3", "robot4"], folder / "lab.yml")

    def apply(self, homes: dict[str, str]) -> None:
        """Have the services on these robots."""
        services = {name: busybox(*(WEB if name == "web" else ()), robot=robot) for name, robot in homes.items()}
        document = edf("band", services, placement={"slots_per_robot": 2})
        self.path.write_text(document, encoding="utf-8")
        done = self.lab.srprov("apply", str(self.path), "-i", self.inventory, "--yes", "--settle", "0", "--json")
        assert done.code == 0, done

    def container(self, service: str, robot: str) -> dict[str, Any]:
        return self.lab.inspect(robot, f"srprov.band.{service}")

    @contextmanager
    def talking(self, service: str, robot: str, *words: str) -> Iterator[dict[str, Any]]:
        """Run `talk.py` in a container's network meanwhile; the dict has what it says in the end."""
        booted = state.read_robot(self.lab.site, robot)
        assert booted is not None
        network = f"/proc/{booted.init.pid}/root/proc/{self.container(service, robot)['State']['Pid']}/ns/net"
        program = ["nsenter", f"--net={network}", sys.executable, str(Path(talk.__file__)), *words]
        said: dict[str, Any] = {}
        with subprocess.Popen(program, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as run:
            assert run.stdout is not None
            assert run.stdout.readline() == "ready\n"
            yield said
            said |= json.loads(run.communicate(timeout=120)[0])


@pytest.fixture
def band(lab: Lab, tmp_path: Path) -> Experiment:
    return Experiment(lab, tmp_path)


def identity(container: dict[str, Any]) -> tuple[str, str]:
    return container["Id"], container["State"]["StartedAt"]


def check_stream(said: dict[str, Any]) -> None:
    assert said["error"] == ""
    for protocol in ("tcp", "udp"):
        assert said[protocol]["longest"] <= MOST_S, said
        assert said[protocol]["answers"] >= said["sent"] - MOST_S / talk.EVERY_S, said


def test_others_talk_on_while_a_robot_joins_and_a_service_moves(
    band: Experiment, record_property: Callable[[str, object], None]
) -> None:
    """Their containers stay the same and their TCP connection lives; the moved one keeps address and name."""
    band.apply(HOMES)
    others = {service: identity(band.container(service, HOMES[service])) for service in ("left", "right")}
    address = {service: address_of(band.lab, robot, f"srprov.band.{service}") for service, robot in HOMES.items()}
    with (
        band.talking("right", "robot2", "echo"),
        band.talking("left", "robot1", "stream", address["right"]) as joining,
    ):
        band.apply(JOINED)
    check_stream(joining)
    with (
        band.talking("right", "robot2", "echo"),
        band.talking("left", "robot1", "stream", address["right"]) as moving,
        band.talking("left", "robot1", "knock", address["web"], "80") as far,
        band.talking("new", "robot4", "knock", address["web"], "80") as near,
    ):
        band.apply(MOVED)
        wait_until(lambda: reached(band.lab, "robot1", "srprov.band.left", ["web"]), 60, "web by its name")
        time.sleep(2 * MOST_S)  # a try that began too early has to end, and one more to go well
    check_stream(moving)
    record_property("talk", {"while a robot joins": joining, "while a service moves": moving})
    assert {one: identity(band.container(one, HOMES[one])) for one in others} == others
    web = band.container("web", "robot4")
    assert address_of(band.lab, "robot4", "srprov.band.web") == address["web"]
    started = datetime.fromisoformat(web["State"]["StartedAt"][:26] + "+00:00").timestamp()
    for who, said in (("left", far), ("new", near)):
        assert said["tries"][0][1], f"{who} was to reach it before"
        waited = min((when - started for when, well in said["tries"] if well and when > started), default=math.inf)
        record_property(f"seconds until {who} reaches web", round(waited, 3))
        assert waited <= MOST_S, (who, started, said["tries"][-100:])
