"""A bundle with images is run again on robots whose engines have none of them, where there is no registry."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from srprov.lab.places import REGISTRY_PORT
from tests.lab.conftest import Lab, edf
from tests.lab.test_image_copies import root
from tests.lab.test_replay import other_inventory, trials
from tests.lab.test_trials import Race, race

pytestmark = pytest.mark.lab

RAN, OTHERS, READER = ("robot1", "robot2"), ("robot3", "robot4"), "robot5"
STATUS = "Package: toy\nStatus: install ok installed\nArchitecture: all\nVersion: 1.0-1\n"
NO_IMAGES = 'i=$(docker images -aq); [ -z "$i" ] || docker rmi -f $i >/dev/null'
JUDGE = "mkdir -p /tmp/judge && cd /tmp/judge && printf 'FROM busybox\\nRUN echo law > /law\\n' > Dockerfile && " \
        "docker build -q -t judge:1 . && rm -r /tmp/judge"  # fmt: skip


def images(lab: Lab, robot: str) -> dict[str, str]:
    """Give name -> id of a robot's images."""
    out = lab.shell(robot, "docker", "images", "--no-trunc", "--format", "{{.Repository}}:{{.Tag}} {{.ID}}").out
    return dict(line.split() for line in out.splitlines())


def unpack(bundle: Path, folder: Path) -> None:
    """Unpack the images alone, as a stranger would."""
    with zipfile.ZipFile(bundle) as archive:
        archive.extractall(folder, [one for one in archive.namelist() if one.startswith("images/")])


@pytest.fixture
def empty(lab: Lab) -> Iterator[Lab]:
    """Give the lab with robots that have no image at all and reach no registry."""
    robots = (*OTHERS, READER)
    for robot in robots:
        lab.shell(robot, "sh", "-c", f"{NO_IMAGES}; iptables -I OUTPUT -p tcp --dport {REGISTRY_PORT} -j REJECT")
    yield lab
    for robot in robots:
        lab.shell(robot, "sh", "-c", f"{NO_IMAGES}; iptables -D OUTPUT -p tcp --dport {REGISTRY_PORT} -j REJECT")
    lab.shell("robot2", "docker", "rmi", "-f", "judge:1", check=False)


def imaged_race(lab: Lab, folder: Path) -> Race:
    """Run the race with an image that srprov built, and one that somebody else built on its robot."""
    lab.shell("robot2", "sh", "-c", JUDGE)
    document: dict[str, Any] = json.loads(race(repetitions=1, exclude=[{"SPEED": 0.4}]))
    racer = document["services"]["racer"]
    del racer["image"]
    racer["cdf"] = "racer.cdf"
    document["services"]["referee"]["image"] = "judge:1"
    (folder / "status").write_text(STATUS)
    cdf = {"cdf": 1, "name": "racer", "base": "busybox", "files": [{"src": "status", "dest": "/var/lib/dpkg/status"}]}
    (folder / "racer.cdf").write_text(json.dumps(cdf))
    one = Race(lab, folder, json.dumps(document))
    done = one.run()
    assert done.code == 0, done
    return one


def ids(folder: Path) -> dict[str, str]:
    """Return service -> the image of its containers, by the engines' word."""
    (found,) = {
        tuple(sorted((name, about["Image"]) for name, about in json.loads(path.read_text()).items()))
        for path in folder.glob("trials/*/containers.json")
    }
    return dict(found)


def test_a_bundle_with_images_needs_no_registry_and_no_build(empty: Lab, tmp_path: Path) -> None:
    lab, first = empty, imaged_race(empty, tmp_path)
    bundle, target = tmp_path / "race.zip", tmp_path / "again"
    made = lab.srprov(
        "bundle", str(first.home), "-o", str(bundle), "--with-images", "all", "-i", first.inventory, "--json"
    )
    assert made.code == 0 and made.json["images"] == 2, made
    other, more = tmp_path / "elsewhere", {"XDG_CACHE_HOME": str(tmp_path / "cache"), "HOME": str(tmp_path)}
    shutil.copytree(first.home, other)
    words = ("bundle", str(other), "-o", str(tmp_path / "b.zip"), "--with-images", "all", "-i", first.inventory)
    again = lab.srprov(*words, env=more)
    assert again.code == 0 and (tmp_path / "b.zip").read_bytes() == bundle.read_bytes(), again
    checked = lab.srprov("verify", str(bundle), "--json")
    results = {one["id"]: one["result"] for one in checked.json["findings"]}
    assert (checked.code, {results[one] for one in ("I1", "I2", "I3", "I4", "S1", "S2")}) == (0, {"pass"}), checked
    with zipfile.ZipFile(bundle) as archive:
        listed = json.loads(archive.read(f"sbom/{ids(first.home)['racer'][7:]}.cdx.json"))
    assert [one["purl"] for one in listed["components"]] == ["pkg:deb/toy@1.0-1?arch=all"]
    assert lab.srprov("destroy", str(first.file), "-i", first.inventory, "--yes").code == 0
    assert [images(lab, robot) for robot in OTHERS] == [{}, {}]
    assert lab.shell("robot3", "docker", "pull", "busybox", check=False).code, "there is no registry"
    words = ("replay", str(bundle), "-i", other_inventory(lab, tmp_path / "other.yml"), "-o", str(target), "--yes",
             "--map", "robot1=kuka", "--map", "robot2=abb", "--margin", "ticks=20")  # fmt: skip
    done = lab.srprov(*words, env={"XDG_CACHE_HOME": str(tmp_path / "third")})
    assert done.code == 0, done
    assert "referee: the bundle's judge:1, " in done.out, done
    compared = lab.srprov("compare", str(bundle), str(target / "run"), "--json")
    grades = {one["id"]: one["grade"] for one in compared.json["sections"] if one["decides"] and one["id"] != "metrics"}
    assert set(grades.values()) == {"identical"} and len(grades) == 4, compared
    assert trials(target / "run") == trials(first.home) and ids(target / "run") == ids(first.home)
    there = {service: f"srprov/bundled:{id_[7:]}" for service, id_ in ids(first.home).items()}
    for robot, service in zip(OTHERS, ("racer", "referee"), strict=True):
        assert images(lab, robot) == {there[service]: ids(first.home)[service]}
    home = yaml.safe_load((target / "run/sessions/1/inputs/inventory.yml").read_text())
    assert set(home["all"]["hosts"]) == set(RAN)
    experiment = str(next((target / "experiment").glob("*.edf")))
    inventory = str(target / "run/sessions/1/inputs/inventory.yml")
    assert lab.srprov("destroy", experiment, "-i", inventory, "--yes").code == 0
    check_docker_load(lab, bundle, tmp_path / "unpacked", ids(first.home))


def check_docker_load(lab: Lab, bundle: Path, folder: Path, wanted: dict[str, str]) -> None:
    """An engine that never saw the images loads them by itself, and runs one."""
    unpack(bundle, folder)
    there = root(lab, READER) / "tmp/layout.tar"
    subprocess.run(["tar", "-C", str(folder / "images"), "-cf", str(there), "."], check=True)
    lab.shell(READER, "sh", "-c", "docker load -i /tmp/layout.tar && rm /tmp/layout.tar")
    loaded = images(lab, READER)
    assert loaded == {f"srprov/bundled:{one[7:]}": one for one in wanted.values()}
    judge = f"srprov/bundled:{wanted['referee'][7:]}"
    assert lab.shell(READER, "docker", "run", "--rm", "--network=none", judge, "cat", "/law").out == "law\n"


def test_a_robot_that_makes_another_image_under_our_tag_brings_it_to_no_other(lab: Lab, tmp_path: Path) -> None:
    """It got a copy of what the builder built. What it has there runs on it, and in nobody's replay."""
    cdf = {"cdf": 1, "name": "talk", "base": "busybox", "run": ["echo law > /law"], "command": ["cat", "/law"]}
    (tmp_path / "talk.cdf").write_text(json.dumps(cdf))
    services = {robot: {"cdf": "talk.cdf", "robot": robot} for robot in RAN}
    one = Race(lab, tmp_path, edf("talk", services, trials={"timeout": "60s"}))
    inventory = yaml.safe_load(Path(one.inventory).read_text())
    inventory["all"]["children"] = {"builders": {"hosts": {"robot2": {}}}}
    Path(one.inventory).write_text(yaml.safe_dump(inventory))
    assert one.run().code == 0
    (tag,) = (name for name in images(lab, "robot1") if name.startswith("srprov/talk:"))
    evil = f"printf 'FROM {tag}\\nRUN echo evil > /law\\n' | docker build -q -t {tag} -"
    lab.shell("robot1", "sh", "-c", evil)
    one.home = tmp_path / "second"
    assert one.run().code == 0
    logs = {path.name.partition(".")[0]: path.read_text() for path in one.home.glob("trials/*/logs/*")}
    assert [logs[robot].endswith(word) for robot, word in zip(RAN, (" evil\n", " law\n"), strict=True)] == [True] * 2
    words = ("-o", str(tmp_path / "b.zip"), "-i", one.inventory)
    for way in ("ours", "all"):
        made = lab.srprov("bundle", str(one.home), *words, "--with-images", way)
        assert made.code == 5 and f"{tag}: the run had " in made.err and "image that was built" in made.err, made
    assert lab.srprov("bundle", str(tmp_path / "run"), *words, "--with-images", "ours").code == 0
    assert lab.srprov("destroy", str(one.file), "-i", one.inventory, "--yes").code == 0
    lab.shell("robot1", "docker", "rmi", "-f", tag)


@pytest.mark.soak
@pytest.mark.skipif(not os.environ.get("SRPROV_SOAK") or not shutil.which("skopeo"), reason="a long test, with skopeo")
def test_skopeo_takes_an_image_of_a_bundle(empty: Lab, tmp_path: Path) -> None:
    lab, first = empty, imaged_race(empty, tmp_path)
    bundle = tmp_path / "race.zip"
    assert (
        lab.srprov("bundle", str(first.home), "-o", str(bundle), "--with-images", "all", "-i", first.inventory).code
        == 0
    )
    unpack(bundle, tmp_path)
    name = f"srprov/bundled:{ids(first.home)['referee'][7:]}"
    words = ["skopeo", "copy", f"oci:{tmp_path}/images:{name}", f"docker-archive:{tmp_path}/judge.tar:judge:1"]
    subprocess.run(words, check=True)
    shutil.copyfile(tmp_path / "judge.tar", root(lab, READER) / "tmp/judge.tar")
    lab.shell(READER, "sh", "-c", "docker load -i /tmp/judge.tar && rm /tmp/judge.tar")
    assert images(lab, READER) == {"judge:1": ids(first.home)["referee"]}
    assert lab.shell(READER, "docker", "run", "--rm", "--network=none", "judge:1", "cat", "/law").out == "law\n"
