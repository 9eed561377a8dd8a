"""What EDFs take over from Compose files, on real robots: own names, homes, seeded volumes, profiles."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.lab.conftest import Done, Lab, busybox, causes, edf, part_of_lab
from tests.lab.looks import ids

pytestmark = pytest.mark.lab

ROBOTS = ["robot1", "robot2"]
OWN, WRITER, EXTRA = (f"srprov.brought.{name}" for name in ("own", "writer", "extra"))
USER = "pilot:x:1500:1500::/srv/pilot:/bin/sh"
SET_UP = (
    f"echo '{USER}' >>/etc/passwd && mkdir -p /srv/pilot/maps && echo lab >/srv/pilot/maps/name"
    " && printf '127.0.0.9 camera.lab cam # front\\n127.0.0.8 writer\\n' >>/etc/hosts"
)
UNDO = (
    "sed -i '/^pilot:/d' /etc/passwd; rm -rf /srv/pilot"
    r"; sed '/camera.lab\|127.0.0.8/d' /etc/hosts >/tmp/h; cat /tmp/h >/etc/hosts"
)


@dataclass
class Brought:
    """The experiment, up without the service that has a profile."""

    lab: Lab
    folder: Path
    words: tuple[str, ...]

    def apply(self, *more: str) -> Done:
        done = self.lab.srprov("apply", *self.words, *more, "--allow", "all", "--yes", "--settle", "0")
        assert done.code == 0, done
        return done

    def plan(self, *more: str) -> dict[str, Any]:
        done = self.lab.srprov("plan", *self.words, *more, "--json")
        assert done.code == 0 and isinstance(done.json, dict), done
        return done.json

    def inside(self, name: str, script: str, robot: str = "robot1") -> str:
        """Give what a shell in a container says."""
        return self.lab.shell(robot, "docker", "exec", name, "sh", "-c", script).out.strip()


@pytest.fixture(scope="module")
def brought(lab_of_module: Lab, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Brought]:
    """Set a robot up as its owner would, and bring the experiment up."""
    folder = tmp_path_factory.mktemp("brought")
    (folder / "config").mkdir()
    (folder / "config" / "params.yml").write_text("speed: 1\n")
    (folder / "config" / "start.sh").write_text("#!/bin/sh\n")
    (folder / "config" / "start.sh").chmod(0o755)
    (folder / "config" / "link").symlink_to("params.yml")
    services = {
        "own": busybox(network="host", robot="robot1", volumes=["~pilot/maps:/maps"]),
        "writer": busybox(robot="robot1", volumes=["config:/config"]),
        "extra": busybox(robot="robot2", profiles=["debug"]),
    }
    text = edf("brought", services, placement={"slots_per_robot": 2},
               volumes={"config": {"seed": "./config", "user": "1500:1501"}})  # fmt: skip
    (folder / "brought.edf").write_text(text, encoding="utf-8")
    lab_of_module.shell("robot1", "sh", "-c", UNDO + "; " + SET_UP)
    words = (str(folder / "brought.edf"), "-i", part_of_lab(lab_of_module, ROBOTS, folder / "lab.yml"))
    made = Brought(lab_of_module, folder, words)
    made.apply()
    yield made
    lab_of_module.shell("robot1", "sh", "-c", UNDO)


def test_a_container_with_its_robots_network_has_the_robots_names_below_the_experiments(brought: Brought) -> None:
    """What the process resolves; a name of the experiment's is never the robot's."""
    assert brought.inside(OWN, "ping -c 1 -W 2 cam | head -1") == "PING cam (127.0.0.9): 56 data bytes"
    lines = brought.inside(OWN, "cat /etc/hosts").splitlines()
    assert [line.split() for line in lines if "camera.lab" in line] == [["127.0.0.9", "camera.lab", "cam"]]
    assert "127.0.0.8" not in " ".join(lines)
    assert "camera.lab" not in brought.inside(WRITER, "cat /etc/hosts")


def test_a_name_that_the_robots_owner_adds_comes_without_a_restart(brought: Brought) -> None:
    before = ids(brought.lab, ["robot1"], "brought")
    brought.lab.shell(
        "robot1", "sh", "-c", "sed 's/ cam / cam lidar.lab /' /etc/hosts >/tmp/h && cat /tmp/h >/etc/hosts"
    )
    (step,) = causes(brought.plan())
    assert step.startswith("robot1/file:")
    brought.apply()
    assert brought.inside(OWN, "ping -c 1 -W 2 lidar.lab | head -1") == "PING lidar.lab (127.0.0.9): 56 data bytes"
    assert ids(brought.lab, ["robot1"], "brought") == before


def test_a_home_is_found_on_the_robot(brought: Brought) -> None:
    (mount,) = [one for one in brought.lab.inspect("robot1", OWN)["Mounts"] if one["Destination"] == "/maps"]
    assert (mount["Source"], brought.inside(OWN, "cat /maps/name")) == ("/srv/pilot/maps", "lab")


def test_a_seed_is_brought_once_and_belongs_to_the_services_from_then_on(brought: Brought) -> None:
    """The service writes beside it; a seed that changes is named, and changes nothing on the robot."""
    assert brought.inside(WRITER, "cd /config && stat -c '%n %a %u:%g' params.yml start.sh && readlink link") == (
        "params.yml 644 1500:1501\nstart.sh 755 1500:1501\nparams.yml"
    )
    brought.inside(WRITER, "echo learned >/config/learned && echo 'speed: 9' >/config/params.yml")
    assert causes(brought.plan()) == {}
    (brought.folder / "config" / "params.yml").write_text("speed: 2\n")
    plan = brought.plan()
    assert causes(plan) == {}
    assert [note for note in plan["notes"] if "srprov.brought.config on robot1 was made with another state" in note]
    brought.apply()
    assert brought.inside(WRITER, "cat /config/params.yml /config/learned") == "speed: 9\nlearned"
    assert "seed" not in brought.lab.shell("robot1", "ls", "/var/lib/srprov/brought").out


def test_a_service_with_a_profile_runs_while_the_profile_is_named(brought: Brought) -> None:
    """In a plan file too; without its name it is a step that removes it, and nobody else is touched."""
    assert ids(brought.lab, ["robot2"], "brought") == {}
    before = ids(brought.lab, ["robot1"], "brought")
    target = brought.folder / "plan.json"
    brought.plan("--profile", "debug", "-o", str(target))
    done = brought.lab.srprov("apply", str(target), "-i", brought.words[2], "--yes", "--settle", "0", "--allow", "all")
    assert done.code == 0, done
    assert set(ids(brought.lab, ["robot2"], "brought")) == {EXTRA}
    assert causes(brought.plan("--profile", "debug")) == {}
    steps = causes(brought.plan())
    assert steps[f"robot2/container:{EXTRA}"].startswith("delete"), steps
    brought.apply()
    assert (ids(brought.lab, ["robot2"], "brought"), ids(brought.lab, ["robot1"], "brought")) == ({}, before)
