"""A host that was set up by hand, built again from its CDF: the same packages, by name, and the same of pip."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.lab import by_hand
from tests.lab.conftest import Done, Lab, part_of_lab

pytestmark = [pytest.mark.lab, pytest.mark.soak]

ROBOT = "robot1"
LISTING = "dpkg-query -W -f '${db:Status-Abbrev} ${Package} ${Version}\\n' | sed -n 's/^[ih]i *//p'"


@pytest.fixture
def hand(lab: Lab) -> Iterator[Lab]:
    """Give the lab; afterwards the robot has nothing of what was installed by hand."""
    yield lab
    by_hand.take_down(lab, ROBOT)


def pairs(done: Done) -> dict[str, str]:
    """Give name -> version of a list with two columns."""
    return {line.split()[0]: line.split()[1] for line in done.out.splitlines() if len(line.split()) >= 2}


def test_a_host_that_is_built_again_has_the_same_packages(hand: Lab, tmp_path: Path) -> None:
    """Names differ in nothing that is not in the report; versions are what the archives have today."""
    repository = tmp_path / "code"
    by_hand.set_up(hand, ROBOT, repository, tmp_path)
    inventory = part_of_lab(hand, [ROBOT], tmp_path / "lab.yml")
    folder = tmp_path / "taken"
    taken = hand.srprov("snapshot", ROBOT, "-i", inventory, "-o", str(folder), "--json")
    assert taken.code == 0, taken
    hand.shell(ROBOT, "docker", "rm", "-f", "Camera.Front", "db", "stopped")  # they have the ports
    variables = {one["env"]: "something" for one in taken.json["secrets"]}
    built = hand.srprov(
        *("build", str(folder / "experiment.edf"), "-i", inventory, "--profile", "host", "--allow", "all", "--yes"),
        env={"XDG_CACHE_HOME": str(tmp_path / "cache"), **variables},
    )
    assert built.code == 0, built
    (image,) = hand.shell(
        ROBOT, "docker", "images", "--format", "{{.Repository}}:{{.Tag}}", f"srprov/{ROBOT}"
    ).out.split()

    def inside(command: str) -> Done:
        return hand.shell(ROBOT, "docker", "run", "--rm", "--network", "none", image, "sh", "-c", command)

    before, after = pairs(hand.shell(ROBOT, "sh", "-c", LISTING)), pairs(inside(LISTING))
    about = taken.json["robots"][ROBOT]["packages"]
    gone, older = set(about["gone"]), set(about["older"])
    assert by_hand.PACKAGE in gone and len(before) > 300
    # what an older package of another maker needs is its own: apt says what goes with it
    theirs = inside(f"apt-get -s purge --autoremove {' '.join(sorted(older))}").out if older else ""
    brought = set(re.findall(r"^(?:Purg|Remv) (\S+)", theirs, re.MULTILINE))
    assert before.keys() - after.keys() - gone == set()
    assert after.keys() - before.keys() - brought == set()

    pip = "python3 -m pip list --disable-pip-version-check 2>/dev/null | sed 1,2d"
    robots, images = pairs(hand.shell(ROBOT, "sh", "-c", pip)), pairs(inside(pip))
    assert robots.keys() == images.keys() and robots["by-hand"] == images["by-hand"] == "1.5"
    assert inside(f"cat {by_hand.WORKSPACE}/speed.yaml").out == "speed: 2\n"
    moved = sorted(name for name in before.keys() & after.keys() if before[name] != after[name])
    other = sum(robots[name] != images[name] for name in robots)
    told = f"{len(before)} packages: {len(gone)} in no archive, {len(older)} only older, {len(brought)} with these"
    print(f"{told}, {len(moved)} in another version; {len(robots)} of pip, {other} of these in another")  # noqa: T201 - figures for the documentation
