"""Two more labs beside the one of the tests: each has its own robots, and none notices when another goes."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from srprov import data
from srprov.lab.places import NAMED_RUN, Site
from tests.lab.conftest import NAME, NOTHING, ROOT, Done, Lab, run_srprov
from tests.lab.looks import wait_until

pytestmark = pytest.mark.lab

EXPERIMENT = str(ROOT / "examples" / "hello" / "experiment.edf")
ROBOTS = ("robot1", "robot2", "robot3")


class OtherLab(Lab):
    """A lab that most words succeed in."""

    def succeed(self, *words: str) -> Done:
        done = self.srprov(*words)
        assert done.code == 0, done
        return done

    def apply(self) -> Done:
        return self.succeed("apply", EXPERIMENT, "-i", str(self.inventory), "--yes", "--json", "--settle", "0")


@pytest.fixture
def pair(lab_session: Lab, tmp_path: Path) -> Iterator[tuple[OtherLab, OtherLab]]:
    """Give two small labs, and take them down."""
    labs = OtherLab(tmp_path, f"{NAME}-a"), OtherLab(tmp_path, f"{NAME}-b")
    try:
        for lab in labs:
            lab.succeed("lab", "up", "-n", str(len(ROBOTS)))
        yield labs
    finally:
        for lab in labs:
            lab.succeed("lab", "down")


def ready(lab: Lab) -> bool:
    """Return whether a lab's first robot is there, whole."""
    return bool(lab.srprov("lab", "status", "--json").json["robots"]["robot1"]["state"] == "ready")


def traces(site: Site) -> list[str]:
    """Give whatever this machine still has of a lab, by the kernel's own word."""
    rules = [line for table in ("iptables-save", "ebtables-save") for line in said(table).splitlines()]
    links = [path.name for path in Path("/sys/class/net").iterdir()]
    mounts = Path("/proc/mounts").read_text().splitlines()
    folders = [site.run, site.disks, *Path("/sys/fs/cgroup").glob(str(site.group))]
    folders += Path("/sys/fs/cgroup").glob(f"*/{site.group}")
    return [
        *(rule for rule in rules if site.tag in rule.split() or site.link_prefix in rule),
        *(link for link in links if link == site.bridge or link.startswith(site.link_prefix)),
        *(mount for mount in mounts if str(site.disks) in mount),
        *(str(folder) for folder in folders if folder.exists()),
        *(line for line in said("ps", "-eo", "args").splitlines() if str(site.run) in line or str(site.disks) in line),
    ]


def said(*command: str) -> str:
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=100).stdout


def test_two_labs_with_the_same_experiment_do_not_meet(pair: tuple[OtherLab, OtherLab], lab_session: Lab) -> None:
    """Each has its own containers, and no packet passes; what one loses the other keeps, and in the end nothing is."""
    one, other = pair
    sites = {lab: lab.site for lab in pair}
    answer = one.succeed("lab", "list", "--json").json
    Draft202012Validator(data.schema("lab-list")).validate(answer)
    listed = answer["labs"]
    mine = {each["name"]: each for each in listed}
    assert {NAME, one.name, other.name} <= set(mine)
    assert len({each["subnet"] for each in listed}) == len(listed)
    assert (mine[one.name]["robots"], mine[one.name]["alive"], mine[one.name]["folders"]) == (3, 3, [str(one.folder)])
    assert str(sites[other].subnet) in one.succeed("lab", "list").out

    assert one.apply().json["changed"] > 0
    assert other.containers("robot1") == {}
    assert other.apply().json["changed"] > 0
    kept = other.everywhere(ROBOTS)
    assert not {*one.everywhere(ROBOTS)["robot1"].values()} & {*kept["robot1"].values()}

    ping = ("ping", "-c", "1", "-W", "1")
    for target in (str(sites[other].address("robot2")), str(lab_session.site.address("robot2"))):
        assert one.shell("robot1", *ping, target, check=False).code == 1, target
    assert one.shell("robot1", *ping, str(sites[one].address("robot2"))).code == 0

    one.succeed("lab", "partition", "robot1")
    one.succeed("lab", "kill", "robot2")
    for lab in pair:
        Draft202012Validator(data.schema("lab-status")).validate(lab.succeed("lab", "status", "--json").json)
    states = {robot: seen["state"] for robot, seen in other.succeed("lab", "status", "--json").json["robots"].items()}
    assert states == dict.fromkeys(ROBOTS, "ready")
    assert {each["name"]: each["alive"] for each in one.succeed("lab", "list", "--json").json["labs"]}[one.name] == 2

    assert traces(sites[one])
    assert one.succeed("lab", "down").err.splitlines()[-1] == f"the lab {one.name} is gone"
    assert traces(sites[one]) == []
    assert not one.inventory.exists() and other.inventory.exists()
    assert other.apply().json["changed"] == 0
    assert other.everywhere(ROBOTS) == kept
    assert other.shell("robot3", "docker", "pull", "-q", "debian:bookworm").code == 0, "its mirror serves on"
    wait_until(lambda: ready(lab_session), 20, "the lab of all other tests is there")
    gone = other.succeed("destroy", EXPERIMENT, "-i", str(other.inventory), "--yes")
    assert [other.leftovers(robot) for robot in ROBOTS] == [NOTHING] * len(ROBOTS), gone

    other.succeed("lab", "down")
    assert traces(sites[other]) == []
    assert not {one.name, other.name} & {path.name for path in NAMED_RUN.iterdir()}


def test_a_lab_that_is_down_says_so_and_leaves_nothing(lab_session: Lab, tmp_path: Path) -> None:
    down = OtherLab(tmp_path, f"{NAME}-down")
    done = down.srprov("lab", "kill", "robot1")
    assert (done.code, done.err.splitlines()) == (
        3,
        [f"error[SRP-011]: the lab {down.name} is down", f"  srprov lab --name {down.name} up"],
    )
    assert down.succeed("lab", "status").out == f"the lab {down.name} is down\n"
    assert down.succeed("lab", "down").err == f"the lab {down.name} is down already\n"
    assert traces(Site(down.name, 98)) == []


def test_a_name_that_a_lab_cannot_have_is_refused(tmp_path: Path) -> None:
    done = run_srprov("lab", "--name", "My Lab", "up", cwd=tmp_path)
    assert done.code == 5 and "at most 20 of a-z, 0-9 and -" in done.err, done
