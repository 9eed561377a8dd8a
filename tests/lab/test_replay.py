"""A bundle is run again on robots of other names and addresses, and compared with what it holds."""

from __future__ import annotations

import csv
import io
import ipaddress
import json
import re
import shutil
import zipfile
from pathlib import Path
from typing import Any

import pytest
import yaml

from srprov.lab import cgroups
from srprov.lab.sites import every
from tests.lab.conftest import ROBOTS, Lab, busybox, edf, part_of_lab
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


def journal(folder: Path) -> list[dict[str, Any]]:
    """Return the events of a run."""
    return [json.loads(line) for line in (folder / "journal.jsonl").read_text().splitlines()]


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
    one = trials(first.home)[0][0]
    part = lab.srprov(*words, "--only", one)
    assert part.code == 0 and "only 1 of 8 trials are compared" in part.err, part
    assert [trial[0] for trial in trials(target / "run")] == [one]
    done = lab.srprov(*words, "--resume")
    assert done.code == 0, done
    begun = [event["trial"] for event in journal(target / "run") if event["event"] == "begin"]
    assert sorted(begun) == sorted(set(begun)) and len(begun) == 8, "what was there is not run again"
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


def test_a_bundle_gets_nothing_of_another_one_that_was_in_the_folder_before(lab: Lab, tmp_path: Path) -> None:
    """Both are called alike, as whoever knows the first one's name can have it, and its user emptied the folder."""
    inventory, bundles = part_of_lab(lab, ["robot1"], tmp_path / "inventory.yml"), []
    given = {"until": {"any": [{"completed": "planner"}]}, "timeout": "20s"}
    for name, command in (("first", "echo private >>/data/notes"), ("second", "cat /data/notes || :")):
        folder = tmp_path / name
        folder.mkdir()
        services = {"planner": busybox("sh", "-c", command, volumes=["data:/data"])}
        (folder / "tour.edf").write_text(edf("tour", services, trials=given))
        run = lab.srprov("run", str(folder / "tour.edf"), "-i", inventory, "-o", str(folder / "run"), "--yes")
        assert run.code == 0, run
        assert lab.srprov("bundle", str(folder / "run"), "-o", str(folder / "tour.zip")).code == 0
        gone = lab.srprov("destroy", str(folder / "tour.edf"), "-i", inventory, "--yes", "--volumes")
        assert gone.code == 0, gone
        bundles.append(str(folder / "tour.zip"))
    again = tmp_path / "again"
    words = ("-i", inventory, "-o", str(again), "--yes")
    for _ in range(2):
        assert lab.srprov("replay", bundles[0], *words).code == 0
        shutil.rmtree(again)
    strange = lab.srprov("replay", bundles[1], *words)
    assert strange.code == 9 and strange.err.count("tour.edf, bundle ") == 2, strange
    file = str(again / "experiment/tour.edf")
    assert lab.srprov("destroy", file, "-i", inventory, "--yes").code == 9
    assert lab.srprov("destroy", "--instance", "tour", "-i", inventory, "--yes").code == 0
    data = lab.srprov("replay", bundles[1], *words)
    assert data.code == 9 and "srprov.tour.data" in data.err, data
    assert lab.srprov("destroy", file, "-i", inventory, "--yes", "--volumes", "--adopt").code == 0
    assert lab.srprov("replay", bundles[1], *words).code in (0, 2)
    assert lab.srprov("destroy", file, "-i", inventory, "--yes", "--volumes").code == 0


WORK = """
read -r before _ </proc/uptime
n=0; while [ "$n" -lt 150000 ]; do n=$((n + 1)); done
read -r after _ </proc/uptime
echo "TOOK $(awk "BEGIN { print $after - $before }")"
"""
SLOW = "robots: {robot2: {cpus: 0.5}}\n"


@pytest.mark.soak  # it tells times of a processor apart, which takes a machine that has nothing else to do
def test_half_of_a_cpu_makes_metrics_different_and_definitions_identical(lab: Lab, tmp_path: Path) -> None:
    """What the slower robot runs is the same by every hash; that it takes longer is told by the metric alone."""
    work = edf(
        "work", {"worker": busybox("sh", "-c", WORK)}, trials={"repetitions": 6, "timeout": "60s"},
        metrics={"took": {"service": "worker", "log": "^TOOK ([0-9.]+)", "unit": "s", "margin": "25%"}},
    )  # fmt: skip
    (tmp_path / "work.edf").write_text(work)
    (tmp_path / "lab-spec.yml").write_text(SLOW)
    up = lab.srprov("lab", "up", "-n", str(ROBOTS), "--spec", str(tmp_path / "lab-spec.yml"))
    assert up.code == 0 and "booting 1 robot\n" in up.err, up
    first, other = (part_of_lab(lab, [robot], tmp_path / f"{robot}.yml") for robot in ("robot1", "robot2"))
    ran = lab.srprov("run", str(tmp_path / "work.edf"), "-i", first, "-o", str(tmp_path / "run"), "--yes")
    assert ran.code == 0, ran
    bundle = str(tmp_path / "work.zip")
    assert lab.srprov("bundle", str(tmp_path / "run"), "-o", bundle).code == 0
    words = ("replay", bundle, "-i", other, "--map", "robot1=robot2", "-o", str(tmp_path / "again"), "--yes", "--json")
    done = lab.srprov(*words)
    assert done.code == 2, done
    grades = {one["id"]: one["grade"] for one in done.json["sections"] if one["decides"]}
    expected = {
        **dict.fromkeys(("definitions", "images", "placement", "execution"), "identical"),
        "metrics": "different",
    }
    assert grades == expected, done
    throttled = [_throttled(lab, robot) for robot in ("robot1", "robot2")]
    assert throttled[0] == 0 < throttled[1], "by the kernel's own count"
    for inventory, file in ((first, "work.edf"), (other, "again/experiment/work.edf")):
        assert lab.srprov("destroy", str(tmp_path / file), "-i", inventory, "--yes").code in (0, 5)


def _throttled(lab: Lab, robot: str) -> int:
    """Return how often the kernel made a robot wait."""
    group = cgroups.ROOT / ("cpu" if cgroups.version() == 1 else "") / lab.site.group / robot
    found = dict(line.split() for line in (group / "cpu.stat").read_text().splitlines())
    return int(found["nr_throttled"])


def published_inventory(lab: Lab, path: Path) -> str:
    """Write an inventory with three robots under other names than the published bundle has."""
    every = yaml.safe_load(lab.inventory.read_text())["all"]
    hosts = {name: every["hosts"][robot] for robot, name in {**OTHERS, "robot5": "ur"}.items()}
    path.write_text(yaml.safe_dump({"all": {"hosts": hosts, "vars": every.get("vars", {})}}))
    return str(path)


def test_the_published_bundle_is_run_again_for_one_point(lab: Lab, tmp_path: Path) -> None:
    """As a stranger does it, with what lies in docs/evidence."""
    published = Path(__file__).parents[2] / "docs" / "evidence"
    with zipfile.ZipFile(published / "race.zip") as archive:
        rows = list(csv.DictReader(io.StringIO(archive.read("trials.csv").decode())))
    point = min(rows, key=lambda row: float(row["duration_s"]))["point"]
    names = sorted(set(read_placement(published / "race.zip").values()))
    maps = [word for old, new in zip(names, ("kuka", "abb", "ur"), strict=False) for word in ("--map", f"{old}={new}")]
    words = ["replay", str(published / "race.zip"), "-i", published_inventory(lab, tmp_path / "inventory.yml"), *maps]
    words += ["--signers", str(published / "signers"), "-o", str(tmp_path / "again"), "--yes"]
    done = lab.srprov(*words, "--only", point, "--margin", "tenths=90%", "--margin", "success=0.9")
    assert done.code == 0 and "only 3 of 18 trials are compared" in done.err, done
    assert "  definitions  identical" in done.out and "  execution    identical" in done.out, done
    ran = trials(tmp_path / "again" / "run")
    assert [one[:2] for one in ran] == [(row["trial"], row["seed"]) for row in rows if row["point"] == point]
    edf = str(tmp_path / "again/experiment" / "experiment.edf")
    inventory = str(tmp_path / "again/run/sessions/1/inputs/inventory.yml")
    assert lab.srprov("destroy", edf, "-i", inventory, "--yes").code == 0


def test_a_stranger_without_robots_runs_it_on_a_lab_that_is_gone_afterwards(lab: Lab, tmp_path: Path) -> None:
    published = Path(__file__).parents[2] / "docs" / "evidence"
    with zipfile.ZipFile(published / "race.zip") as archive:
        rows = list(csv.DictReader(io.StringIO(archive.read("trials.csv").decode())))
    trial = min(rows, key=lambda row: float(row["duration_s"]))["trial"]
    words = ("replay", str(published / "race.zip"), "--lab", "-o", str(tmp_path / "again"), "--yes", "--only", trial)
    before = sorted(lab.folder.iterdir())
    done = lab.srprov(*words, "--margin", "success=0.9")
    assert done.code == 0, done
    # what the bundle's machines and this one have different is named; on another processor or kernel it is not nothing
    assert len(re.findall(r"^  robot[123] is robot[123]: \S", done.out, re.MULTILINE)) == 3, done
    assert "  definitions  identical" in done.out and "  execution    identical" in done.out, done
    hosts = json.loads((tmp_path / "again/run/sessions/1/inputs/inventory.yml").read_text())["all"]["hosts"]
    addresses = [ipaddress.IPv4Address(host["ansible_host"]) for host in hosts.values()]
    assert len(addresses) == 3
    assert not any(address in site.subnet for address in addresses for site in every()), "its lab is gone"
    assert sorted(lab.folder.iterdir()) == before, "its inventory too"


def read_placement(bundle: Path) -> dict[str, str]:
    """Return service -> robot of a bundle's last session."""
    with zipfile.ZipFile(bundle) as archive:
        last = max(name for name in archive.namelist() if name.endswith("/assignment.json"))
        found: dict[str, str] = json.loads(archive.read(last))["assignment"]
        return found
