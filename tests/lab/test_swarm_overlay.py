"""A robot's Docker Swarm keeps its VXLAN links where the robot shows none: no instance gets a VNI of theirs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.lab.conftest import Lab, busybox, edf, part_of_lab

pytestmark = pytest.mark.lab

ROBOTS = ("robot1", "robot2")


@pytest.fixture
def swarm(lab: Lab) -> Iterator[int]:
    """Have robot2 be in a swarm of its own, with an overlay; give that one's VNI."""
    lab.shell("robot2", "docker", "swarm", "init", "--advertise-addr", "eth0")
    try:
        lab.shell("robot2", "docker", "network", "create", "-d", "overlay", "--attachable", "theirs")
        lab.shell("robot2", "docker", "run", "-d", "--rm", "--name", "theirs", "--network", "theirs", "busybox",
                  "sleep", "86400")  # fmt: skip
        form = '{{index .Options "com.docker.network.driver.overlay.vxlanid_list"}}'
        yield int(lab.shell("robot2", "docker", "network", "inspect", "--format", form, "theirs").out)
    finally:
        lab.shell("robot2", "sh", "-c", "docker rm -f theirs; docker swarm leave --force", check=False)


def test_an_overlay_gets_no_vni_of_a_swarm(lab: Lab, swarm: int, tmp_path: Path) -> None:
    """The link failed on that robot alone, and the other one sent it what it takes for its own."""
    inventory, path = part_of_lab(lab, ROBOTS, tmp_path / "lab.yml"), tmp_path / "x.edf"
    services = {name: busybox("sleep", "86400", robot=robot) for name, robot in zip("ab", ROBOTS, strict=True)}
    path.write_text(edf("x", services, network={"vni": swarm}))
    shown = lab.shell("robot2", "ip", "-d", "link", "show", "type", "vxlan").out
    assert f"vxlan id {swarm}" not in shown
    refused = lab.srprov("plan", str(path), "-i", inventory, "--allow", "host-network")
    assert refused.code == 5 and f"network.vni {swarm} is used by link swarm-" in refused.err, refused
    path.write_text(edf("x", services, network={"vni": 4000}))
    asked = lab.srprov("apply", str(path), "-i", inventory, "--yes")
    assert "host-network" in asked.err and "4000 may be the VNI of an overlay" in asked.err, asked
