"""Exports of real robots: a plan's placement with their addresses; and exported files, run there by Compose alone."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from srprov.lab import state
from tests.lab.conftest import ROOT, Lab, busybox, edf, part_of_lab
from tests.lab.looks import log_of, wait_until
from tests.real_compose import binary

pytestmark = pytest.mark.lab

ROBOTS = ("robot1", "robot2", "robot3")
HELLO = ROOT / "examples" / "hello" / "experiment.edf"


def test_a_plan_is_exported_for_its_robots_with_their_addresses(lab: Lab, tmp_path: Path) -> None:
    """As the robots themselves say where they are; and not when the EDF is another one by then."""
    path = tmp_path / "experiment.edf"
    services = {"one": busybox(), "two": busybox(), "bag": busybox(volumes=["~root:/bags:ro"])}
    path.write_text(edf("exported", services), encoding="utf-8")
    inventory, plan = part_of_lab(lab, ROBOTS, tmp_path / "lab.yml"), tmp_path / "plan.json"
    assert lab.srprov("plan", str(path), "-i", inventory, "-o", str(plan)).code == 0
    placed = json.loads(plan.read_text())["assignment"]

    made = lab.srprov("export", "compose", str(plan), "-o", str(tmp_path / "out"), "--json")

    assert made.code == 0, made
    assert {name: one["robot"] for one in made.json["machines"] for name in one["services"]} == placed
    for name, robot in placed.items():
        document = yaml.safe_load((tmp_path / "out" / robot / "compose.yml").read_text())
        hosts = dict(line.split("=") for line in document["services"][name]["extra_hosts"])
        assert hosts.keys() == placed.keys()
        for other, address in hosts.items():
            assert f" {address}/" in lab.shell(placed[other], "ip", "-4", "addr").out

    known = lab.srprov("export", "compose", str(path), "-i", inventory, "-o", str(tmp_path / "asked"), "--json")
    assert known.code == 0, known
    bag = next(tmp_path / "asked" / one["file"] for one in known.json["machines"] if "bag" in one["services"])
    assert yaml.safe_load(bag.read_text())["services"]["bag"]["volumes"][0]["source"] == "/root"

    path.write_text(path.read_text().replace("sleep", "sleep "), encoding="utf-8")
    stale = lab.srprov("export", "compose", str(plan), "-o", str(tmp_path / "late"))
    assert (stale.code, "has changed since plan.json was made" in stale.err) == (5, True), stale
    assert not (tmp_path / "late").exists()


@pytest.fixture
def compose(lab: Lab) -> Iterator[str]:
    """Put the real Compose on the robots; give its path there."""
    places = [_root(lab, robot) / "root" / "compose" for robot in ROBOTS]
    for place in places:
        place.mkdir()
        shutil.copy(binary(), place / "docker-compose")
    yield "/root/compose/docker-compose"
    for robot, place in zip(ROBOTS, places, strict=True):
        lab.shell(
            robot, "sh", "-c", "cd /root/compose/export && ../docker-compose down -v --rmi local -t 1", check=False
        )
        shutil.rmtree(place)


def _root(lab: Lab, robot: str) -> Path:
    booted = state.read_robot(lab.site, robot)
    assert booted is not None
    return Path(f"/proc/{booted.init.pid}/root")


def _up(lab: Lab, robot: str, folder: Path, compose: str) -> None:
    shutil.copytree(folder, _root(lab, robot) / "root" / "compose" / "export", symlinks=True)
    lab.shell(robot, "sh", "-c", f"cd /root/compose/export && {compose} up -d")


def _heard(lab: Lab, robot: str) -> bool:
    return any(
        line.startswith("web says: Hello from a folder") for line in log_of(lab, robot, "srprov-hello-greeter-1")
    )


def test_an_exported_example_runs_with_compose_alone(lab: Lab, compose: str, tmp_path: Path) -> None:
    """On one robot as its twin: the greeter hears the web server, the job ended with 0, the shipped file is served."""
    assert lab.srprov("export", "compose", str(HELLO), "-o", str(tmp_path / "twin")).code == 0
    _up(lab, "robot1", tmp_path / "twin", compose)
    wait_until(lambda: _heard(lab, "robot1"), 30, "the greeter hears the web server")
    wait_until(lambda: not lab.inspect("robot1", "srprov-hello-once-1")["State"]["Running"], 30, "the job ends")
    assert lab.inspect("robot1", "srprov-hello-once-1")["State"]["ExitCode"] == 0
    assert lab.inspect("robot1", "srprov-hello-web-1")["State"]["Health"]["Status"] == "healthy"


def test_exported_robots_know_each_other_with_compose_alone(lab: Lab, compose: str, tmp_path: Path) -> None:
    """Each service is on a robot of its own, and finds the others by their names."""
    inventory = part_of_lab(lab, ROBOTS, tmp_path / "lab.yml")
    made = lab.srprov("export", "compose", str(HELLO), "-i", inventory, "-o", str(tmp_path / "robots"), "--json")
    assert made.code == 0, made
    home = {name: one["robot"] for one in made.json["machines"] for name in one["services"]}
    assert sorted(home.values()) == sorted(ROBOTS)
    for robot in (home["web"], home["greeter"], home["once"]):
        _up(lab, robot, tmp_path / "robots" / robot, compose)
    wait_until(lambda: _heard(lab, home["greeter"]), 30, "the greeter hears the web server of another robot")
    wait_until(lambda: not lab.inspect(home["once"], "srprov-hello-once-1")["State"]["Running"], 30, "the job ends")
    assert lab.inspect(home["once"], "srprov-hello-once-1")["State"]["ExitCode"] == 0


RICH = """\
edf: 1
name: rich
secrets: {key: {file: key.txt}}
volumes: {notes: {seed: ./notes}}
services:
  web:
    cdf: web.cdf
  ask:
    image: busybox
    network: host
    secrets: [key]
    volumes: ["notes:/notes", "./own:/own"]
    command:
      - sh
      - -c
      - |
        until wget -q -O - http://web:8080/page.txt; do sleep 0.2; done
        cat /run/secrets/key /notes/seed.txt /own/a.txt
        for one in /run/secrets/key /own/a.txt; do (echo >>$one) 2>/dev/null && echo writable; done
        echo $0 $HOME >/notes/written && cat /notes/written
        exec sleep 86400
      - $literal
    stop_signal: SIGKILL
"""
CDF = """\
cdf: 1
base: busybox
files: [{src: page.txt, dest: /www/page.txt}]
run: chmod 444 /www/page.txt
command: [httpd, -f, -p, "8080", -h, /www]
stop_signal: SIGKILL
"""


def test_what_is_built_shipped_seeded_and_secret_is_there_with_compose_alone(
    lab: Lab, compose: str, tmp_path: Path
) -> None:
    """An image of a CDF, a service of the robot's own network that knows another, a seed, a secret, a dollar.

    Of what is in the export, the seed alone can be written to.
    """
    files = {"notes/seed.txt": "the seed\n", "own/a.txt": "shipped\n", "page.txt": "the page\n", "key.txt": "never\n"}
    for name, text in {**files, "rich.edf": RICH, "web.cdf": CDF}.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    order = ("export", "compose", str(tmp_path / "rich.edf"), "-o", str(tmp_path / "out"))
    assert lab.srprov(*order).code == 9, "the seed is a folder of the user's"
    done = lab.srprov(*order, "--allow", "host-path")
    assert done.code == 0, done
    assert "you must give the file secrets/key" in done.out
    (tmp_path / "out" / "secrets" / "key").write_text("given\n")
    _up(lab, "robot1", tmp_path / "out", compose)
    lines = ["the page", "given", "the seed", "shipped", "$literal /root"]
    wait_until(lambda: log_of(lab, "robot1", "srprov-rich-ask-1")[-len(lines) :] == lines, 20, "all of it is there")
    web = lab.inspect("robot1", "srprov-rich-web-1")
    assert web["Config"]["Hostname"] == "web"


def test_an_exported_experiment_runs_no_image_that_another_one_built(lab: Lab, compose: str, tmp_path: Path) -> None:
    """A stranger's `nav` had a service `planner-db`; the user's `nav-planner` ran that image as its `db`."""
    for name, service in (("nav", "planner-db"), ("nav-planner", "db")):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "a.cdf").write_text(f"cdf: 1\nbase: busybox\nrun: echo {name} >/made-by\ncommand: cat /made-by\n")
        (folder / "a.edf").write_text(f"edf: 1\nname: {name}\nservices: {{{service}: {{cdf: a.cdf}}}}\n")
        done = lab.srprov("export", "compose", str(folder / "a.edf"), "-o", str(tmp_path / "out" / name))
        assert done.code == 0, done
    place = _root(lab, "robot1") / "root" / "compose" / "both"
    shutil.copytree(tmp_path / "out", place)
    lab.shell("robot1", "docker", "pull", "-q", "busybox")
    for name, orders in (("nav", "up -d && sleep 1 && {0} down -t 1"), ("nav-planner", "up -d && sleep 1")):
        lab.shell("robot1", "sh", "-c", f"cd /root/compose/both/{name} && {compose} {orders.format(compose)}")
    assert log_of(lab, "robot1", "srprov-nav-planner-db-1") == ["nav-planner"]
    lab.shell("robot1", "sh", "-c", f"cd /root/compose/both/nav-planner && {compose} down -t 1 --rmi all")
