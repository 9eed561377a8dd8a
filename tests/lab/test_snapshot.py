"""Robots that were set up by hand become an experiment, whatever they hold; no secret is told, nothing is changed."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from jsonschema import Draft202012Validator

from srprov import data
from tests.lab import by_hand
from tests.lab.by_hand import PACKAGE, PASSWORD, TOKEN, WORKSPACE
from tests.lab.conftest import Done, Lab, part_of_lab

pytestmark = pytest.mark.lab

ROBOT = "robot1"


@pytest.fixture
def hand(lab: Lab) -> Iterator[Lab]:
    """Give the lab; afterwards the robot has nothing of what was installed by hand."""
    yield lab
    by_hand.take_down(lab, ROBOT)


def texts(done: Done, folder: Path) -> str:
    """Give all that was printed and written."""
    files = [path.read_bytes().decode("utf-8", "replace") for path in sorted(folder.rglob("*")) if path.is_file()]
    return "\n".join([done.out, done.err, *map(str, sorted(folder.rglob("*"))), *files])


def notes(document: dict[str, object], kind: str) -> list[str]:
    """Give the notes of a kind, as text."""
    found = document["notes"]
    assert isinstance(found, list)
    return [f"{note['subject']}: {note['words']}" for note in found if note["kind"] == kind]


def test_a_robot_that_was_set_up_by_hand_becomes_an_experiment(hand: Lab, tmp_path: Path) -> None:
    """Its containers and its host, with what could not be captured; the passwords are in no output."""
    repository = tmp_path / "code"
    commit = by_hand.set_up(hand, ROBOT, repository, tmp_path)
    inventory = part_of_lab(hand, [ROBOT], tmp_path / "lab.yml")
    folder = tmp_path / "taken"
    done = hand.srprov("snapshot", ROBOT, "-i", inventory, "-o", str(folder), "--json")
    assert done.code == 0, done
    assert list(Draft202012Validator(data.schema("snapshot")).iter_errors(done.json)) == []
    everything = texts(done, folder)
    for secret in (PASSWORD, TOKEN):
        assert secret not in everything and base64.b64encode(secret.encode()).decode()[:-4] not in everything
    assert hand.srprov("validate", str(folder / "experiment.edf")).code == 0

    edf = yaml.safe_load((folder / "experiment.edf").read_text(encoding="utf-8"))
    assert set(edf["services"]) == {"camera-front", "db", f"{ROBOT}-host"} and edf["placement"] == {
        "slots_per_robot": 3
    }
    camera, db = edf["services"]["camera-front"], edf["services"]["db"]
    digest = hand.inspect(ROBOT, "db")["Image"]
    assert camera.pop("image").startswith("busybox:latest@sha256:") and digest
    assert camera == {
        "network": "host", "command": ["sh", "-c", "exec sleep 86400"], "environment": ["ROS_DOMAIN_ID=7"],
        "secrets": ["camera-front-db_password"], "cap_add": ["SYS_NICE"], "devices": ["/dev/net/tun:/dev/lidar"],
        "ulimits": {"nofile": {"soft": 1024, "hard": 2048}}, "restart": "unless-stopped", "robot": ROBOT,
        "volumes": [{"type": "bind", "source": "/opt/data", "target": "/data", "read_only": True},
                    {"type": "volume", "source": "maps", "target": "/maps"}],
    }  # fmt: skip
    assert db["environment"] == ["TWO=a\nb"] and db["secrets"] == ["db-token"] and db["cpus"] == 0.5
    assert (db["mem_limit"], db["ports"], db["tmpfs"]) == ("67108864", ["127.0.0.1:5432:80"], ["/tmp:size=8m"])
    assert db["command"][-2:] == ["--password", "***"] and db["labels"] == {"team": "drive"}
    assert (
        db["stop_grace_period"] == "3s"
        and db["healthcheck"]["interval"] == "7s"
        and "***" in db["healthcheck"]["test"][1]
    )
    assert edf["secrets"]["camera-front-db_password"] == {"env": "CAMERA_FRONT__DB_PASSWORD"}

    cdf = yaml.safe_load((folder / f"{ROBOT}.cdf").read_text(encoding="utf-8"))
    assert (
        cdf["base"] == "debian:bookworm" and "git" in cdf["packages"]["apt"] and PACKAGE not in cdf["packages"]["apt"]
    )
    places = {one["path"]: one for one in cdf["repositories"]}
    assert places[WORKSPACE] == {"git": f"file://{repository}", "ref": commit, "path": WORKSPACE}
    assert places["/usr/src/srprov-pip/by-hand"]["ref"] == commit
    patch = (folder / ROBOT / "patches" / "0.patch").read_text(encoding="utf-8")
    assert "+speed: 2" in patch and "login.yaml" not in patch
    lost = "\n".join(notes(done.json, "lost"))
    for words in (f"package {PACKAGE}: is in none", "not tracked: not-tracked", "stopped: does not run", "/etc/changed",
                  "the volume maps holds"):  # fmt: skip
        assert words in lost, (words, lost)
    assert any("login.yaml" in one for one in notes(done.json, "secret"))
    assert any(one.startswith("workspace /home/robot/ws: of colcon") for one in notes(done.json, "adapted"))

    words = (f"{ROBOT}-host", "--profile", "host", "--allow", "git", "--allow", "outside")
    own = {"XDG_CACHE_HOME": str(tmp_path / "cache")}
    shown = hand.srprov("build", "--show", str(folder / "experiment.edf"), *words, env=own)
    assert shown.code == 0 and "git apply --whitespace=nowarn" in shown.out, shown
    again = hand.srprov("snapshot", ROBOT, "-i", inventory, "-o", str(folder))
    assert again.code == 5 and "is there already" in again.err, again
