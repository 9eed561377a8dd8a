"""Volumes that an EDF shares with a service of a stranger's CDF, on real engines."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.lab.conftest import Lab, busybox, edf, part_of_lab

pytestmark = pytest.mark.lab

ROBOT = "robot1"
VALUE = "token-of-the-planner"


def test_what_a_service_reads_alone_gets_no_file_of_its_image(lab: Lab, tmp_path: Path) -> None:
    """An engine fills an empty volume with what the image has at that place, whether or not its container may write.

    The user's own service runs what lies there, with its secret.
    """
    (tmp_path / "run.sh").write_text("cp /run/secrets/token /ws/leak\n", encoding="utf-8")
    files = "[{src: run.sh, dest: /ws/run.sh}]"
    (tmp_path / "camera.cdf").write_text(
        f"cdf: 1\nbase: busybox\nfiles: {files}\ncommand: sleep 86400\nstop_signal: SIGKILL\n", encoding="utf-8"
    )
    script = "[ -e /ws/run.sh ] || echo ': own' >/ws/run.sh; sh /ws/run.sh; exec sleep 86400"
    services = {
        "camera": {"cdf": "camera.cdf", "volumes": ["ws:/ws:ro"]},
        "planner": busybox("sh", "-c", script, volumes=["ws:/ws"], secrets=["token"], depends_on=["camera"]),
    }
    path = tmp_path / "share.edf"
    more = {"secrets": {"token": {"env": "LAB_TOKEN"}}, "placement": {"slots_per_robot": 2}}
    path.write_text(edf("share", services, **more), encoding="utf-8")
    inventory = part_of_lab(lab, [ROBOT], tmp_path / "lab.yml")
    words = (str(path), "-i", inventory, "--allow", "secret")
    done = lab.srprov("apply", *words, "--yes", "--settle", "0", env={"LAB_TOKEN": VALUE})
    assert done.code == 0, done
    for service in ("camera", "planner"):
        there = lab.shell(ROBOT, "docker", "exec", f"srprov.share.{service}", "sh", "-c", "cat /ws/run.sh; ls /ws").out
        assert there.split() == [":", "own", "run.sh"], there
    plan = lab.srprov("plan", *words, env={"LAB_TOKEN": VALUE})
    assert plan.code == 0 and "Nothing to do" in plan.out, plan
    lab.srprov("destroy", str(path), "-i", inventory, "--yes", "--volumes")
