"""Data sets on real robots: each content once, read-only, right by its hash, and gone with the last who uses it."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import pytest

from tests.lab.conftest import NOTHING, Lab, busybox, causes, edf, part_of_lab

pytestmark = pytest.mark.lab

STORE = "/var/lib/srprov/.data"


def test_a_content_is_on_a_robot_once_for_all_and_goes_with_the_last(lab: Lab, tmp_path: Path) -> None:
    """Two services and two experiments share it; what was cut off goes on where it ended, and nothing is left."""
    content = os.urandom(3 << 20)
    sha256 = hashlib.sha256(content).hexdigest()
    (tmp_path / "run.bag").write_bytes(content)
    inventory = part_of_lab(lab, ["robot1"], tmp_path / "lab.yml")
    data = [{"path": "run.bag", "target": "/data/run.bag", "sha256": sha256}]
    for name, services in (("one", ("a", "b")), ("two", ("c",))):
        text = edf(
            name, {one: busybox(data=data, network="none") for one in services}, placement={"slots_per_robot": 4}
        )
        (tmp_path / f"{name}.edf").write_text(text, encoding="utf-8")
    one, two = ((str(tmp_path / f"{name}.edf"), "-i", inventory, "--yes") for name in ("one", "two"))

    # an earlier try, of which the connection was cut
    part = f"mkdir -p {STORE}/{sha256} && head -c 1000 >{STORE}/{sha256}/part"
    lab.shell("robot1", "sh", "-c", f"echo {content[:1000].hex()} | xxd -r -p | ({part})")
    for words in (one, two):
        done = lab.srprov("apply", *words, "--settle", "0")
        assert done.code == 0, done
    inside = "sha256sum /data/run.bag; stat -c %i /data/run.bag; echo x 2>/dev/null >/data/run.bag || echo read-only"
    said = {
        lab.shell("robot1", "docker", "exec", container, "sh", "-c", inside).out
        for container in ("srprov.one.a", "srprov.one.b", "srprov.two.c")
    }
    assert len(said) == 1 and said.pop().split()[0::3] == [sha256, "read-only"]
    assert lab.shell("robot1", "find", STORE, "-type", "f").out == f"{STORE}/{sha256}/data\n"
    again = lab.srprov("plan", *one[:-1], "--json")
    assert causes(again.json) == {}, again

    assert lab.srprov("destroy", *one).code == 0
    assert lab.shell("robot1", "sha256sum", f"{STORE}/{sha256}/data").out.startswith(sha256)
    assert lab.srprov("destroy", *two).code == 0
    assert lab.leftovers("robot1") == NOTHING
