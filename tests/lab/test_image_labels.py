"""Labels of a published image on a real engine: they are its container's, too, and other programs go by them."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.lab.conftest import Lab, busybox, edf, part_of_lab

pytestmark = pytest.mark.lab

ROBOT = "robot1"


def test_a_published_image_makes_no_container_one_of_composes(lab: Lab, tmp_path: Path) -> None:
    """Compose would make it anew as its service's, with the container's volumes and the service's rights.

    It asks an engine for the labels of its project, and of a service that was not run once.
    """
    said = {"project": "nav", "service": "planner", "oneoff": "False", "container-number": "1", "config-hash": "x"}
    labels = " ".join(f"com.docker.compose.{key}={value}" for key, value in said.items())
    script = f"printf 'FROM busybox\\nVOLUME /bin\\nLABEL {labels}\\n' | docker build -q -t published:1 -"
    lab.shell(ROBOT, "sh", "-c", script)
    path = tmp_path / "look.edf"
    path.write_text(edf("look", {"cam": {**busybox(), "image": "published:1", "robot": ROBOT}}), encoding="utf-8")
    inventory = part_of_lab(lab, [ROBOT], tmp_path / "lab.yml")
    done = lab.srprov("apply", str(path), "-i", inventory, "--yes", "--settle", "0")
    assert done.code == 0, done
    asked = [f"--filter=label=com.docker.compose.{key}={said[key]}" for key in ("project", "oneoff")]
    assert lab.shell(ROBOT, "docker", "ps", "-aq", "--filter=name=srprov.look.cam").out
    assert not lab.shell(ROBOT, "docker", "ps", "-aq", *asked).out
    asked[1] = "--filter=label=com.docker.compose.service=planner"
    assert not lab.shell(ROBOT, "docker", "ps", "-aq", *asked).out
    plan = lab.srprov("plan", str(path), "-i", inventory)
    assert plan.code == 0 and "Nothing to do" in plan.out, plan
    lab.srprov("destroy", str(path), "-i", inventory, "--yes")
    lab.shell(ROBOT, "docker", "rmi", "published:1")
