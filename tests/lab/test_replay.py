"""A bundle is run again on robots of other names and addresses, and compared with what it holds."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.lab.conftest import Lab
from tests.lab.test_trials import Race, race

pytestmark = pytest.mark.lab

OTHERS = {"robot3": "kuka", "robot4": "abb"}


def other_inventory(lab: Lab, path: Path) -> str:
    """Write an inventory with two robots under names that the bundle does not know."""
    every = yaml.safe_load(lab.inventory.read_text())["all"]
    hosts = {name: every["hosts"][robot] for robot, name in OTHERS.items()}
    path.write_text(yaml.safe_dump({"all": {"hosts": hosts, "vars": every.get("vars", {})}}))
    return str(path)


def trials(folder: Path) -> list[tuple[str, ...]]:
    """Return what must be the same wherever it is run, in its order."""
    with (folder / "trials.csv").open(newline="") as stream:
        return [tuple(one[key] for key in ("trial", "seed", "status", "verdict")) for one in csv.DictReader(stream)]


def test_a_bundle_is_run_again_on_other_robots(lab: Lab, tmp_path: Path) -> None:
    first = Race(lab, tmp_path, race())
    assert first.run().code == 0
    bundle, target = tmp_path / "race.zip", tmp_path / "again"
    assert lab.srprov("bundle", str(first.home), "-o", str(bundle)).code == 0
    assert lab.srprov("destroy", str(first.file), "-i", first.inventory, "--yes").code == 0
    words = ["replay", str(bundle), "-i", other_inventory(lab, tmp_path / "other.yml"), "-o", str(target), "--yes"]
    nobody = lab.srprov(*words)
    assert nobody.code == 5 and "there is no robot robot1 in the inventory" in nobody.err, nobody
    assert not target.exists()
    words += ["--map", "robot1=kuka", "--map", "robot2=abb", "--margin", "ticks=20"]
    done = lab.srprov(*words)
    assert done.code == 0, done
    assert "robot1 is kuka: the same kind of machine" in done.out and done.out.endswith("\nequivalent\n"), done
    assert trials(target / "run") == trials(first.home)
    hosts: dict[str, Any] = json.loads((target / "run/sessions/1/inputs/inventory.yml").read_text())["all"]["hosts"]
    addresses = yaml.safe_load(lab.inventory.read_text())["all"]["hosts"]
    assert {name: one["ansible_host"] for name, one in hosts.items()} == {
        "robot1": addresses["robot3"]["ansible_host"], "robot2": addresses["robot4"]["ansible_host"],
    }  # fmt: skip
    compared = lab.srprov("compare", str(first.home), str(target / "run"), "--margin", "ticks=20", "--json")
    grades = {one["id"]: one["grade"] for one in compared.json["sections"] if one["decides"]}
    assert grades.pop("metrics") in ("identical", "equivalent")
    assert set(grades.values()) == {"identical"} and len(grades) == 4, grades
    again = str(next((target / "experiment").glob("*.edf")))
    assert lab.srprov("destroy", again, "-i", str(target / "run/sessions/1/inputs/inventory.yml"), "--yes").code == 0
