"""A user who is not root: everything is done through `sudo -n`, and nobody logs in as root."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from tests.lab.conftest import NOTHING, ROOT, Lab, part_of_lab
from tests.lab.test_image_copies import received

pytestmark = pytest.mark.lab

ROBOTS = ["robot1", "robot2", "robot3"]
USER = {"ansible_user": "robot"}


def logins(lab: Lab, robot: str) -> list[str]:
    """Give the users whom a robot's sshd has let in, in order."""
    return re.findall(r"Accepted publickey for (\S+)", lab.shell(robot, "cat", "/var/log/sshd.log").out)


def test_apply_twice_and_destroy_work_through_sudo(lab: Lab, tmp_path: Path) -> None:
    """The example comes up, stays as it is at the second apply, and goes away; only the user `robot` logs in."""
    shutil.copytree(ROOT / "examples" / "hello", tmp_path / "hello")
    experiment = str(tmp_path / "hello" / "experiment.edf")
    inventory = part_of_lab(lab, ROBOTS, tmp_path / "lab.yml", **dict.fromkeys(ROBOTS, USER))
    assert lab.shell("robot1", "su", "robot", "-c", "id -u").out.strip() not in ("", "0")
    before = {robot: len(logins(lab, robot)) for robot in ROBOTS}

    first = lab.srprov("apply", experiment, "-i", inventory, "--yes", "--json")
    assert first.code == 0, first
    home = first.json["assignment"]
    assert sorted(home.values()) == ROBOTS
    said = lab.shell(home["greeter"], "docker", "logs", "srprov.hello.greeter").out
    assert "web says: Hello from a folder beside the experiment." in said
    assert lab.shell(home["web"], "stat", "-c", "%U", "/var/lib/srprov/hello/hosts").out == "root\n"

    running = lab.everywhere(ROBOTS)
    second = lab.srprov("apply", experiment, "-i", inventory, "--yes", "--json")
    assert second.code == 0, second
    assert (second.json["changed"], second.json["failed"], second.json["steps"]) == (0, 0, [])
    as_root = lab.srprov(
        "plan", experiment, "-i", str(lab.inventory), "--limit", ",".join(ROBOTS), "--detailed-exitcode"
    )
    assert as_root.code == 0, as_root
    assert lab.everywhere(ROBOTS) == running

    logs = lab.srprov("logs", experiment, "-i", inventory, "--tail", "1", "greeter")
    assert logs.code == 0 and logs.out.startswith("greeter | web says:"), logs
    known = lab.srprov("facts", "-i", inventory, "--json")
    assert {(one["user"], one["privileged"]) for one in known.json["robots"].values()} == {("robot", True)}
    gone = lab.srprov("destroy", experiment, "-i", inventory, "--yes", "--json")
    assert gone.code == 0, gone
    assert [lab.leftovers(robot) for robot in ROBOTS] == [NOTHING] * 3
    for robot in ROBOTS:
        # `plan` above was root's; all others were not
        assert logins(lab, robot)[before[robot] :] == ["robot"] * 2 + ["root"] + ["robot"] * 3


def test_a_user_who_may_not_become_root_is_told_what_to_do(lab: Lab, tmp_path: Path) -> None:
    """Without the sudo rule the robot counts as unreachable, and the remedy in the message works as it stands.

    That he may use Docker makes no difference: nothing is sent to such a robot.
    """
    shutil.copytree(ROOT / "examples" / "hello", tmp_path / "hello")
    inventory = part_of_lab(lab, ROBOTS[:1], tmp_path / "lab.yml", robot1=USER)
    rule = "/etc/sudoers.d/srprov-lab"
    lab.shell("robot1", "mv", rule, "/root/rule")
    try:
        refused = lab.srprov("facts", "-i", inventory)
        assert refused.code == 4, refused
        assert "user 'robot' cannot become root" in refused.err and "ansible_user: root" in refused.err
        for group in ("-a", "-d"):
            lab.shell("robot1", "gpasswd", group, "robot", "docker")
            before = received(lab, "robot1")
            refused = lab.srprov("apply", str(tmp_path / "hello" / "experiment.edf"), "-i", inventory, "--yes")
            assert refused.code == 4, refused
            assert re.search(
                "reached; robot1: user 'robot' cannot become root: .*sudoers.d/srprov", refused.err, re.DOTALL
            )
            assert received(lab, "robot1") - before < 30_000 and lab.leftovers("robot1") == NOTHING
        remedy = re.search(
            r"without a password: (echo .+? \| sudo tee (/etc/sudoers\.d/srprov)) on the robot", refused.err
        )
        assert remedy, refused
        lab.shell("robot1", "sh", "-c", remedy[1])
        fine = lab.srprov("facts", "-i", inventory)
        assert fine.code == 0, fine
        lab.shell("robot1", "rm", remedy[2])
    finally:
        lab.shell("robot1", "sh", "-c", f"mv /root/rule {rule}; gpasswd -a robot docker")
