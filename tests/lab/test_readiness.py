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


def test_a_labs_policy_limits_containers_and_forbids_what_flags_allow(lab: Lab, tmp_path: Path) -> None:
    """What the policy does not allow is refused with its file and line; what it limits, the engine limits."""
    inventory = part_of_lab(lab, ["robot1"], tmp_path / "lab.yml")
    policy = tmp_path / "config" / "srprov" / "policy.yml"
    policy.parent.mkdir(parents=True)
    policy.write_text("policy: 1\nallow: {all: []}\nlimits:\n  memory: {default: 64m, max: 1g}\n  pids: {max: 32}\n")
    path = tmp_path / "experiment.edf"

    def apply(**fields: Any) -> Done:
        path.write_text(edf("limited", {"a": busybox(network="none", **fields)}))
        words = ("apply", str(path), "-i", inventory, "--yes", "--settle", "0", "--allow", "all")
        return lab.srprov(*words, env={"XDG_CONFIG_HOME": str(tmp_path / "config")})

    refused = apply(privileged=True)
    assert (refused.code, f"{policy}:2 does not allow privileged on robot1" in refused.err) == (9, True), refused
    greedy = apply(pids_limit=33)
    assert (greedy.code, f"{policy}:5 does not allow 33 processes" in greedy.err) == (9, True), greedy
    assert apply(cpus=0.5).code == 0
    host = lab.inspect("robot1", "srprov.limited.a")["HostConfig"]
    assert (host["CpuQuota"], host["CpuPeriod"], host["PidsLimit"]) == (50_000, 100_000, 32)
    assert (host["Memory"], host["MemorySwap"]) == (64 << 20, 64 << 20)
    assert lab.srprov("destroy", "--instance", "limited", "-i", inventory, "--yes").code == 0


def test_facts_name_the_addresses_that_a_robot_relies_on(lab: Lab, tmp_path: Path) -> None:
    """This machine, which reaches it by SSH, and its gateways, by the robot's own tools."""
    inventory = part_of_lab(lab, ["robot1"], tmp_path / "lab.yml")
    facts = lab.srprov("facts", "-i", inventory, "--json").json["robots"]["robot1"]
    routes = lab.shell("robot1", "ip", "-4", "route").out.split()
    gateways = {routes[at + 1] for at, word in enumerate(routes) if word == "via"}
    servers = {line.split()[1] for line in lab.shell("robot1", "cat", "/etc/resolv.conf").out.splitlines()
               if line.startswith("nameserver") and not line.split()[1].startswith("127.")}  # fmt: skip
    assert set(facts["relies_on"]) >= {str(lab.site.controller), *gateways, *servers}
