"""Exported stacks, run by Docker Swarm alone on robots of the lab: placed as the assignment says, in their order."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from srprov.lab import state
from tests.lab.conftest import ROOT, Lab, part_of_lab
from tests.lab.looks import wait_until

pytestmark = pytest.mark.lab

ROBOTS = ("robot1", "robot2", "robot3")


@pytest.fixture
def manager(lab: Lab) -> Iterator[str]:
    """Make a swarm of three robots; give the manager, and take the swarm apart again."""
    address = lab.shell("robot1", "sh", "-c", "ip -4 -o addr show eth0").out.split()[3].partition("/")[0]
    lab.shell("robot1", "docker", "swarm", "init", "--advertise-addr", address)
    token = lab.shell("robot1", "docker", "swarm", "join-token", "-q", "worker").out.strip()
    try:
        for robot in ROBOTS[1:]:
            lab.shell(robot, "docker", "swarm", "join", "--token", token, f"{address}:2377")
        yield "robot1"
    finally:
        for robot in reversed(ROBOTS):
            lab.shell(robot, "sh", "-c", "docker swarm leave --force; rm -rf /root/stack", check=False)


def _copied(lab: Lab, robot: str, folder: Path) -> None:
    booted = state.read_robot(lab.site, robot)
    assert booted is not None
    shutil.copytree(folder, f"/proc/{booted.init.pid}/root/root/stack", symlinks=True)


def _exported(lab: Lab, edf: Path, tmp_path: Path) -> dict[str, str]:
    """Export an experiment; return service -> robot."""
    inventory = part_of_lab(lab, ROBOTS, tmp_path / "lab.yml")
    made = lab.srprov("export", "swarm", str(edf), "-i", inventory, "-o", str(tmp_path / "stack"), "--json")
    assert made.code == 0, made
    return {name: one["robot"] for one in made.json["machines"] for name in one["services"]}


def _task(lab: Lab, manager: str, service: str) -> tuple[str, str]:
    """Return the node and the state of a service's newest task, as the manager says."""
    said = lab.shell(manager, "docker", "service", "ps", "--format", "{{json .}}", service).out.splitlines()
    one = json.loads(said[0])
    return one["Node"], one["CurrentState"].split()[0]


def test_hello_runs_on_a_swarm_where_the_assignment_says(lab: Lab, manager: str, tmp_path: Path) -> None:
    home = _exported(lab, ROOT / "examples" / "hello" / "experiment.edf", tmp_path)
    assert sorted(home.values()) == sorted(ROBOTS)
    _copied(lab, manager, tmp_path / "stack")
    done = lab.shell(manager, "sh", "-c", "/root/stack/deploy.sh 2>&1")
    assert "waiting for web to be running" in done.out

    wait_until(lambda: _task(lab, manager, "hello_once")[1] == "Complete", 60, "the job ends with 0")
    heard = "docker service logs --raw hello_greeter 2>&1"
    wait_until(lambda: "Hello from a folder" in lab.shell(manager, "sh", "-c", heard).out, 60, "the greeter hears")
    assert {name: _task(lab, manager, f"hello_{name}")[0] for name in home} == home
    lab.shell(manager, "docker", "stack", "rm", "hello")


@pytest.mark.soak
def test_ros_nodes_talk_on_a_swarm(lab: Lab, manager: str, tmp_path: Path) -> None:
    """Images are built on their robots by the script, and the listener hears the talker over Swarm's own overlay."""
    home = _exported(lab, ROOT / "examples" / "chatter-ros" / "experiment.edf", tmp_path)
    for robot in ROBOTS:
        _copied(lab, robot, tmp_path / "stack")
        lab.shell(robot, "sh", "-c", "/root/stack/build.sh", limit_s=1200)
    lab.shell(manager, "sh", "-c", "/root/stack/deploy.sh 2>&1", limit_s=400)
    heard = "docker service logs --raw chatter-ros_listener 2>&1"
    wait_until(
        lambda: "heard: hello from talker" in lab.shell(manager, "sh", "-c", heard).out,
        120,
        "the listener hears the talker",
    )
    assert {name: _task(lab, manager, f"chatter-ros_{name}")[0] for name in home} == home
    lab.shell(manager, "docker", "stack", "rm", "chatter-ros")


CONSOLE = """
import socket, subprocess
server = socket.create_server(("127.0.0.1", 4444))
while True:
    subprocess.Popen(["/bin/sh"], stdin=server.accept()[0])
"""
"""A console that root left on the loopback."""


def test_build_sh_builds_what_the_cdf_names_and_nothing_else(lab: Lab, tmp_path: Path) -> None:
    """A file `Dockerfile` beside it had the engine tell a console of root's what to do; no report said a word."""
    context = tmp_path / "ctx"
    context.mkdir()
    (context / "talker.dockerfile").write_text('FROM busybox\nCMD ["echo", "looked at"]\n')
    order = "ADD http://127.0.0.1:4444/;touch\\$IFS/root/told; /x"
    (context / "Dockerfile").write_text(f'FROM busybox\n{order}\nCMD ["echo", "not looked at"]\n')
    (tmp_path / "talker.cdf").write_text("cdf: 1\ndockerfile: {context: ctx, dockerfile: talker.dockerfile}\n")
    edf = tmp_path / "experiment.edf"
    edf.write_text("edf: 1\nname: built\nservices: {talker: {cdf: talker.cdf, robot: robot1}}\n")
    _exported(lab, edf, tmp_path)
    tag = (tmp_path / "stack" / "build.sh").read_text().split()[-2]
    begun = f"setsid python3 -c '{CONSOLE}' </dev/null >/dev/null 2>&1 & echo $! >/root/console; sleep 1"
    lab.shell("robot1", "sh", "-c", begun)
    try:
        _copied(lab, "robot1", tmp_path / "stack")
        lab.shell("robot1", "sh", "-c", "timeout 30 /root/stack/build.sh", check=False)
        told = lab.shell("robot1", "ls", "/root/told", check=False)
        said = lab.shell("robot1", "docker", "run", "--rm", tag, check=False)
    finally:
        lab.shell("robot1", "sh", "-c", "kill $(cat /root/console); rm -rf /root/stack /root/told /root/console")
        lab.shell("robot1", "docker", "rmi", "-f", tag, check=False)
    assert told.code != 0 and said.out == "looked at\n", (told, said)
