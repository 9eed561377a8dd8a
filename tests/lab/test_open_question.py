"""A question of `apply` stands while its user applies an experiment of his own, which has the same name."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.lab.conftest import Lab, busybox, edf, part_of_lab
from tests.lab.test_daily_use import Terminal

pytestmark = pytest.mark.lab

NAME, ROBOT = "question", "robot1"


def test_nobody_joins_an_instance_that_somebody_else_made_while_he_was_asked(lab: Lab, tmp_path: Path) -> None:
    """Its service has another name, and a hosts file of its own: all that it needs is there as it was planned."""
    inventory = part_of_lab(lab, [ROBOT], tmp_path / "lab.yml")
    files = {}
    for who, services in {
        "late": {"evil": busybox(hostname="vault.lab.example", extra_hosts=["x:10.1.2.3"])},
        "first": {"web": busybox(environment={"TOKEN": "the-user-s"})},
    }.items():
        (tmp_path / who).mkdir()
        files[who] = tmp_path / who / "question.edf"
        files[who].write_text(edf(NAME, services), encoding="utf-8")
    asking = Terminal(lab, "apply", str(files["late"]), "-i", inventory, "--runs", str(tmp_path / "runs"))
    asking.says("", "Do this?")
    words = ("-i", inventory, "--yes", "--settle", "0", "--runs", str(tmp_path / "runs"))
    assert lab.srprov("apply", str(files["first"]), *words).code == 0
    asking.says("y\n", "nothing was done")
    assert asking.run.wait(timeout=120) == 9 and f"{ROBOT} changed since the plan was made" in asking.shown
    os.close(asking.end)
    assert [*lab.containers(ROBOT)] == ["srprov.question.web"]
    again = lab.srprov("plan", str(files["first"]), "-i", inventory)
    assert again.code == 0 and "Nothing to do" in again.out, again
