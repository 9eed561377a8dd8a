"""Compose files and SwarmRob's definitions, imported and run on real robots; what runs is asked of Docker itself."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.lab.conftest import Lab, part_of_lab

pytestmark = pytest.mark.lab

ROBOTS = ["robot1", "robot2", "robot3"]
CASES = Path(__file__).parents[1] / "cases" / "conversion"
HERE = ("--allow", "all", "--yes", "--settle", "0")


class Imported:
    """An experiment that was made of other tools' files, in a folder of its own."""

    def __init__(self, lab: Lab, folder: Path, robots: list[str], *words: str) -> None:
        self.lab = lab
        self.folder = folder / "out"
        done = lab.srprov("import", *words, "-o", str(self.folder))
        assert done.code == 0, str(done)
        hosts = {robot: {"srprov_slots": 2} for robot in robots}
        hosts.get("robot2", {})["srprov_devices"] = ["/dev/null"]
        self.words = (str(self.folder / "experiment.edf"), "-i", part_of_lab(lab, robots, folder / "lab.yml", **hosts))

    def apply(self) -> None:
        done = self.lab.srprov("apply", *self.words, *HERE)
        assert done.code == 0, str(done)

    def plan(self) -> dict[str, int]:
        """Give how many steps of each kind a plan has now."""
        done = self.lab.srprov("plan", *self.words, "--json", "--detailed-exitcode")
        assert done.code == 0, str(done)
        assert isinstance(done.json["counts"], dict)
        return done.json["counts"]

    def where(self, instance: str, robots: list[str]) -> dict[str, str]:
        """Give container -> robot, of the instance's, as Docker lists what runs or has ended."""
        names = {robot: self.lab.containers(robot) for robot in robots}
        prefix = f"srprov.{instance}."
        return {name.removeprefix(prefix): robot for robot, found in names.items() for name in found if prefix in name}

    def destroy(self) -> None:
        assert self.lab.srprov("destroy", *self.words, "--volumes", "--yes").code == 0


@pytest.fixture(scope="module")
def stack(lab_of_module: Lab, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Imported]:
    """Import the stack of one rover, with the lab's images, and bring it up on three robots.

    Robots of the lab cannot give a container all privileges: not every machine that has the lab has them itself.
    """
    folder = tmp_path_factory.mktemp("stack")
    shutil.copytree(CASES / "stack", folder / "stack")
    words = (
        "compose",
        str(folder / "stack" / "compose.yaml"),
        "--set",
        "ROS_IMAGE=busybox",
        "--set",
        "PRIVILEGED=false",
    )
    made = Imported(lab_of_module, folder, ROBOTS, *words)
    made.apply()
    yield made
    made.destroy()


def test_a_published_stack_runs_on_three_robots(stack: Imported) -> None:
    """Six services and a job; the one with the device runs where the device is."""
    where = stack.where("rover-stack", ROBOTS)
    assert sorted(where) == ["base", "calibrate", "lidar", "mapper", "roscore", "web"]
    assert set(where.values()) == set(ROBOTS) and where["base"] == "robot2"
    states = {name: stack.lab.inspect(robot, f"srprov.rover-stack.{name}")["State"] for name, robot in where.items()}
    assert {name: state["Status"] for name, state in states.items()} == {
        **dict.fromkeys(where, "running"), "calibrate": "exited",
    }  # fmt: skip
    assert states["roscore"]["Health"]["Status"] == "healthy" and states["calibrate"]["ExitCode"] == 0
    # what the mapper says at its start: the job's work in the volume they share, and the master by its old name
    said = stack.lab.shell(where["mapper"], "docker", "logs", "srprov.rover-stack.mapper").out
    assert said == "mapping with wheels: 4, master ready\n"


def test_containers_have_what_the_compose_file_says(stack: Imported) -> None:
    where = stack.where("rover-stack", ROBOTS)
    base = stack.lab.inspect("robot2", "srprov.rover-stack.base")
    host = base["HostConfig"]
    assert (host["NetworkMode"], host["IpcMode"]) == ("host", "host")
    assert host["Devices"] == [{"PathOnHost": "/dev/null", "PathInContainer": "/dev/rover", "CgroupPermissions": "rwm"}]
    assert {"ROS_DOMAIN_ID=7", "ROS_HOME=/tmp/ros 7"} <= set(base["Config"]["Env"])
    assert stack.lab.shell("robot2", "docker", "exec", "srprov.rover-stack.base", "cat", "/etc/base.yaml").out == (
        "wheels: 4\n"
    )
    lidar = stack.lab.inspect(where["lidar"], "srprov.rover-stack.lidar")
    assert lidar["HostConfig"]["CapAdd"] == ["CAP_SYS_NICE"] or lidar["HostConfig"]["CapAdd"] == ["SYS_NICE"]
    assert {one["Name"]: one["Hard"] for one in lidar["HostConfig"]["Ulimits"]} == {"core": 0, "nofile": 4096}
    assert lidar["Config"]["Cmd"][2] == "echo lidar of $HOSTNAME at ${LIDAR_BAUD}; exec sleep 86400"
    web = stack.lab.inspect(where["web"], "srprov.rover-stack.web")["HostConfig"]
    assert (web["CpuQuota"] / web["CpuPeriod"], web["Memory"]) == (0.5, 64 << 20)
    assert web["RestartPolicy"]["Name"] == "unless-stopped"
    assert list(web["PortBindings"]) == ["80/tcp"]


def test_a_plan_after_apply_is_empty(stack: Imported) -> None:
    counts = stack.plan()
    assert sum(counts.values()) == 0, counts


def test_two_machines_files_are_one_experiment(lab_of_module: Lab, tmp_path: Path) -> None:
    """Each on its robot; a service of one finds a service of the other by its name."""
    shutil.copytree(CASES / "pair", tmp_path / "pair")
    files = [str(tmp_path / "pair" / name) for name in ("compose.robot.yaml", "compose.pc.yaml")]
    words = ("compose", *files, "--robot-map", str(tmp_path / "pair" / "robots.yml"), "--name", "pair")
    pair = Imported(lab_of_module, tmp_path, ROBOTS[:2], *words)
    pair.apply()
    assert pair.where("pair", ROBOTS[:2]) == {
        "driver": "robot1", "agent": "robot1", "viewer": "robot2", "agent-robot2": "robot2",
    }  # fmt: skip
    lab_of_module.shell("robot2", "sh", "-c", "until docker logs srprov.pair.viewer | grep -q .; do sleep 0.1; done")
    assert lab_of_module.shell("robot2", "docker", "logs", "srprov.pair.viewer").out == "speed 3\n"
    seen = lab_of_module.shell("robot1", "docker", "exec", "srprov.pair.agent", "cat", "/driver/Dockerfile").out
    assert seen == (CASES / "pair" / "driver" / "Dockerfile").read_text()
    assert sum(pair.plan().values()) == 0
    pair.destroy()


SWARM = """version: '3'
services:
  rosmaster:
    image: hub:5000/helloworld
    environment:
      - ROS_IP=hm_rosmaster_1
  camera:
    image: hub:5000/helloworld
    environment:
      - ROS_URI=http://hm_rosmaster_1:8000
      - CAMERA_NAME=Cam
    depends_on:
      - rosmaster
    devices:
      - /dev/null:/dev/video0
  viewer:
    image: hub:5000/helloworld
    depends_on:
      - camera
      - rosmaster
"""


def test_an_experiment_of_swarmrob_runs_on_two_robots(lab_of_module: Lab, tmp_path: Path) -> None:
    """Its image is built of its Dockerfile; the name that containers had is found from another robot."""
    (tmp_path / "helloworld").mkdir()
    (tmp_path / "swarm.yaml").write_text(SWARM)
    (tmp_path / "helloworld" / "Dockerfile").write_text(
        "FROM busybox\nSTOPSIGNAL SIGKILL\nCMD httpd -f -p 8000 -h /etc\n"
    )
    words = ("swarmrob", str(tmp_path / "swarm.yaml"), str(tmp_path / "helloworld" / "Dockerfile"), "--name", "swarm")
    swarm = Imported(lab_of_module, tmp_path, ROBOTS[:2], *words)
    swarm.apply()
    where = swarm.where("swarm", ROBOTS[:2])
    assert sorted(where) == ["camera", "rosmaster", "viewer"] and set(where.values()) == {"robot1", "robot2"}
    assert where["camera"] == "robot2"
    camera = lab_of_module.inspect("robot2", "srprov.swarm.camera")
    assert {"ROS_URI=http://hm_rosmaster_1:8000", "CAMERA_NAME=Cam"} <= set(camera["Config"]["Env"])
    assert [one["PathInContainer"] for one in camera["HostConfig"]["Devices"]] == ["/dev/video0"]
    fetch = ("docker", "exec", "srprov.swarm.viewer", "wget", "-q", "-O-", "http://hm_rosmaster_1:8000/hostname")
    assert lab_of_module.shell(where["viewer"], *fetch).out.strip() == "hm_rosmaster_1"
    assert json.loads(lab_of_module.srprov("status", *swarm.words, "--json").out)
    swarm.destroy()


HEALTHY = """services:
  sensor: {image: "lab/sensor:1", pull_policy: never, command: sleep 86400, stop_signal: SIGKILL}
  reader:
    image: busybox
    command: sleep 86400
    stop_signal: SIGKILL
    depends_on: {sensor: {condition: service_healthy}}
"""
BUILD = "printf 'FROM busybox\\n%s\\n' '{}' | docker build -q -t lab/sensor:1 - >/dev/null"


def test_a_healthcheck_that_lives_in_an_image_is_awaited(lab_of_module: Lab, tmp_path: Path) -> None:
    """Compose finds it when it runs; here it is written down that there is one, and an image without one is told."""
    (tmp_path / "c.yaml").write_text(HEALTHY)
    check = "HEALTHCHECK --interval=1s --retries=20 CMD test -e /ready || ! touch /ready"
    lab_of_module.shell("robot1", "sh", "-c", BUILD.format(check))
    healthy = Imported(lab_of_module, tmp_path, ROBOTS[:1], "compose", str(tmp_path / "c.yaml"), "--name", "healthy")
    healthy.apply()
    states = [lab_of_module.inspect("robot1", f"srprov.healthy.{name}")["State"] for name in ("sensor", "reader")]
    first_healthy = next(one["Start"] for one in states[0]["Health"]["Log"] if one["ExitCode"] == 0)
    assert states[0]["Health"]["Status"] == "healthy" and first_healthy < states[1]["StartedAt"]
    assert sum(healthy.plan().values()) == 0
    healthy.destroy()
    lab_of_module.shell("robot1", "sh", "-c", BUILD.format("LABEL none=1"))
    done = lab_of_module.srprov("apply", *healthy.words, *HERE)
    assert done.code == 3 and "srprov.healthy.sensor has no healthcheck: neither the definitions" in done.err, str(done)
    healthy.destroy()
    lab_of_module.shell("robot1", "docker", "rmi", "lab/sensor:1")
