"""Ports and folders of real robots: what a placement and a plan know of them before anything is changed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.lab.conftest import Done, Lab, busybox, changed, edf, part_of_lab

pytestmark = pytest.mark.lab

FOLDER = "/srv/made-by-a-plan"


def test_a_robots_ports_and_folders_are_known_before_anything_is_changed(lab: Lab, tmp_path: Path) -> None:
    """Replicas with one port run on two robots although one has room for both; a port of sshd and a folder that is not
    there are errors of the plan; a folder is made where the EDF says so."""
    robots = ["robot1", "robot2"]
    inventory = part_of_lab(lab, robots, tmp_path / "lab.yml")
    path = tmp_path / "experiment.edf"
    httpd = ("busybox", "httpd", "-f", "-p", "80", "-h", "/etc")
    web = busybox(*httpd, ports=["8080:80"], replicas=2)

    def run(verb: str, **services: dict[str, Any]) -> Done:
        path.write_text(edf("room", services, placement={"slots_per_robot": 4}))
        allow = ("--allow", "low-port", "--allow", "host-path")
        ask = ("--yes", "--settle", "0") if verb == "apply" else ()
        return lab.srprov(verb, str(path), "-i", inventory, "--json", *allow, *ask)

    def mounting(**more: Any) -> dict[str, Any]:
        mount = {"type": "bind", "source": FOLDER, "target": "/x", **more}
        return busybox(robot="robot1", network="none", volumes=[mount])

    taken = run("plan", a=busybox(ports=["22:80"], robot="robot1"))
    assert (taken.code, "port 22/tcp is taken by sshd" in taken.err) == (8, True), taken
    absent = run("plan", m=mounting())
    assert (absent.code, f"robot1: {FOLDER}, which 'm' mounts, does not exist" in absent.err) == (5, True), absent
    assert lab.shell("robot1", "ls", FOLDER, check=False).code != 0
    done = run("apply", web=web, m=mounting(bind={"create_host_path": True}))
    assert done.code == 0, done
    assert lab.shell("robot1", "stat", "-c", "%U %a", FOLDER).out == "root 755\n"
    names = {robot: lab.shell(robot, "docker", "ps", "--format", "{{.Names}} {{.Ports}}").out for robot in robots}
    assert all(names[robot].count("0.0.0.0:8080->80/tcp") == 1 for robot in robots), names
    again = run("apply", web=web, m=mounting(bind={"create_host_path": True}))
    assert (again.code, changed(again.json)) == (0, set()), again
    assert lab.srprov("destroy", "--instance", "room", "-i", inventory, "--yes").code == 0
    lab.shell("robot1", "rmdir", FOLDER)
