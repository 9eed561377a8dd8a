"""The main job on real robots: up, again without a change, and away without a trace.

Every test has robots of its own, so nothing has to be cleaned in between.
"""

from __future__ import annotations

import shutil
import time
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.lab.conftest import NOTHING, ROOT, Lab, busybox, changed, edf, part_of_lab

pytestmark = pytest.mark.lab

TRACES = """
docker ps --all --no-trunc --format 'container {{.Names}} {{.ID}} {{.State}}'
docker network ls --no-trunc --format 'network {{.Name}} {{.ID}}'
docker volume ls --format 'volume {{.Name}}'
ip -br link | sed 's/@.*//; s/ .*//; s/^/link /' | grep -v veth
ip route | sed 's/^/route /'
iptables-save | grep ^-A | sort
find /var/lib/srprov -mindepth 1 2>/dev/null | sed 's/^/file /'
true
"""
"""Everything that a run could leave on a robot, whoever it belongs to; images are a cache and stay."""


@pytest.fixture
def hello(tmp_path: Path) -> Path:
    """Give a copy of examples/hello that a test may edit."""
    shutil.copytree(ROOT / "examples" / "hello", tmp_path / "hello")
    return tmp_path / "hello" / "experiment.edf"


def traces(lab: Lab, robots: list[str]) -> dict[str, list[str]]:
    return {robot: lab.shell(robot, "sh", "-c", TRACES).out.splitlines() for robot in robots}


def pair(name: str, first: str, second: str, **more: Any) -> str:
    """Give the EDF of two services on two robots."""
    return edf(name, {"left": busybox(robot=first, **more), "right": busybox(robot=second)})


def test_without_terminal_and_without_yes_nothing_is_done(lab_of_module: Lab, hello: Path, tmp_path: Path) -> None:
    """With nobody to ask, `apply` and `destroy` refuse with 9 before they touch a robot."""
    lab, robots = lab_of_module, ["robot1", "robot2", "robot3"]
    inventory = part_of_lab(lab, robots, tmp_path / "lab.yml")
    before = traces(lab, robots)
    for verb in ("apply", "destroy"):
        begun = time.monotonic()
        refused = lab.srprov(verb, str(hello), "-i", inventory)
        assert refused.code == 9, refused
        assert "--yes" in refused.err
        assert time.monotonic() - begun < 60
    assert traces(lab, robots) == before


def test_the_example_comes_up_and_a_second_apply_changes_nothing(
    lab_of_module: Lab, hello: Path, tmp_path: Path
) -> None:
    """`plan` sees differences and makes none, `apply` makes the experiment true, and then there is nothing to do."""
    lab, robots = lab_of_module, ["robot1", "robot2", "robot3"]
    inventory = part_of_lab(lab, robots, tmp_path / "lab.yml")
    plan = ("plan", str(hello), "-i", inventory, "--detailed-exitcode")

    planned = lab.srprov(*plan)
    assert planned.code == 2, planned
    assert [lab.leftovers(robot) for robot in robots] == [NOTHING] * 3

    first = lab.srprov("apply", str(hello), "-i", inventory, "--yes", "--json")
    assert first.code == 0, first
    ids = lab.everywhere(robots)
    home = {name.rpartition(".")[2]: robot for robot, there in ids.items() for name in there}
    assert home == first.json["assignment"]
    assert sorted(home) == ["greeter", "once", "web"]
    assert sorted(home.values()) == robots, "one slot per robot"
    once = lab.inspect(home["once"], "srprov.hello.once")["State"]
    assert (once["Status"], once["ExitCode"]) == ("exited", 0)
    said = lab.shell(home["greeter"], "docker", "logs", "srprov.hello.greeter").out
    assert "web says: Hello from a folder beside the experiment." in said

    empty = lab.srprov(*plan)
    assert empty.code == 0, empty
    before = traces(lab, robots)
    second = lab.srprov("apply", str(hello), "-i", inventory, "--yes", "--json")
    assert second.code == 0, second
    assert (second.json["changed"], second.json["failed"], second.json["steps"]) == (0, 0, [])
    assert second.json["unchanged"] > 0
    assert traces(lab, robots) == before
    assert lab.everywhere(robots) == ids


def test_destroy_takes_the_instance_and_nothing_else(lab_of_module: Lab, tmp_path: Path) -> None:
    """After `destroy` a robot is as before, foreign things untouched; data stays until `--volumes`; twice is fine."""
    lab, robots = lab_of_module, ["robot4", "robot5"]
    inventory = part_of_lab(lab, robots, tmp_path / "lab.yml")
    by_hand = (
        "docker run -d --name web --hostname left busybox sleep 86400; "
        "docker run -d --name lookalike --label srprov.instance.x=mine --label srprov.instances=mine busybox sleep 1d; "
        "docker run -d --name srprov.mine.other busybox sleep 86400; "
        "docker network create --label srprov.instance.x=mine srprov-lookalike; "
        "docker volume create --label srprov.instance.x=mine srprov-lookalike; "
        "mkdir -p /var/lib/srprov-of-others && echo keep > /var/lib/srprov-of-others/file"
    )
    lab.shell("robot4", "sh", "-ec", by_hand)
    before = traces(lab, robots)
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "file.txt").write_text("shipped", encoding="utf-8")
    neighbour, mine = tmp_path / "neighbour.edf", tmp_path / "mine.edf"
    neighbour.write_text(pair("mine-2", *robots), encoding="utf-8")
    mine.write_text(pair("mine", *robots, volumes=["data:/data", "./parts:/parts:ro"]), encoding="utf-8")

    def run(*words: str) -> Any:
        done = lab.srprov(*words, "-i", inventory, "--yes", "--json")
        assert done.code == 0, done
        return done

    run("apply", str(neighbour), "--settle", "0")
    with_neighbour = traces(lab, robots)
    run("apply", str(mine), "--settle", "0")
    lab.shell("robot4", "docker", "exec", "srprov.mine.left", "sh", "-c", "cat /parts/file.txt > /data/result")

    kept = run("destroy", str(mine))
    volume = "srprov.mine.data"
    assert "1 data volume(s) stay: srprov.mine.data; --volumes removes them" in kept.err
    after = traces(lab, robots)
    assert after["robot5"] == with_neighbour["robot5"]
    assert after["robot4"] == sorted([*with_neighbour["robot4"], f"volume {volume}"], key=after["robot4"].index)
    result = f"/var/lib/docker/volumes/{volume}/_data/result"
    assert lab.shell("robot4", "cat", result).out == "shipped"

    gone = run("destroy", str(mine), "--volumes")
    assert gone.json["changed"] == 1
    assert traces(lab, robots) == with_neighbour
    again = run("destroy", str(mine), "--volumes")
    assert (again.json["changed"], again.json["steps"]) == (0, [])
    run("destroy", "--instance", "mine-2")
    assert traces(lab, robots) == before
    assert lab.shell("robot4", "cat", "/var/lib/srprov-of-others/file").out == "keep\n"


def test_destroy_says_that_data_is_lost_and_does_not_take_it_by_the_way(lab_of_module: Lab, tmp_path: Path) -> None:
    """With `--volumes`, one `destroy` takes the running services and their data, and the steps say so."""
    lab, robots = lab_of_module, ["robot6", "robot7"]
    inventory = part_of_lab(lab, robots, tmp_path / "lab.yml")
    path = tmp_path / "data.edf"
    path.write_text(pair("data", *robots, volumes=["log:/data"]), encoding="utf-8")
    before = traces(lab, robots)
    up = lab.srprov("apply", str(path), "-i", inventory, "--yes", "--settle", "0")
    assert up.code == 0, up
    assert "volume srprov.data.log" in "\n".join(traces(lab, robots)["robot6"])
    gone = lab.srprov("destroy", str(path), "-i", inventory, "--yes", "--volumes")
    assert gone.code == 0, gone
    assert "- #" in gone.out and "volume srprov.data.log: destroy  DATA IS LOST" in gone.out
    assert traces(lab, robots) == before


def test_a_container_that_inherits_our_labels_is_not_ours(lab_of_module: Lab, tmp_path: Path) -> None:
    """`docker commit` hands a service's labels on to whatever runs from that image; it is its maker's all the same."""
    lab, robots = lab_of_module, ["robot6", "robot7"]
    inventory = part_of_lab(lab, robots, tmp_path / "lab.yml")
    path = tmp_path / "saved.edf"
    path.write_text(pair("saved", *robots), encoding="utf-8")
    up = lab.srprov("apply", str(path), "-i", inventory, "--yes", "--settle", "0")
    assert up.code == 0, up
    by_hand = "docker commit srprov.saved.left kept; docker run -d --name byhand kept sleep 86400"
    lab.shell("robot6", "sh", "-ec", by_hand)
    assert lab.inspect("robot6", "byhand")["Config"]["Labels"]["srprov.instance"] == "saved"
    mine = lab.containers("robot6", running=True)["byhand"]
    plan = lab.srprov("plan", str(path), "-i", inventory, "--json")
    assert plan.json["steps"] == []
    gone = lab.srprov("destroy", str(path), "-i", inventory, "--yes")
    assert gone.code == 0, gone
    assert lab.containers("robot6", running=True) == {"byhand": mine}
    lab.shell("robot6", "docker", "rm", "-f", "byhand")


@pytest.mark.parametrize("how", ["renamed", "broken", "no EDF"])
def test_destroy_after_the_experiment_was_edited(lab_of_module: Lab, tmp_path: Path, how: str) -> None:
    """What was made is found by its labels, whatever the EDF says by now."""
    lab = lab_of_module
    robots = {"renamed": ["robot8", "robot9"], "broken": ["robot10", "robot11"], "no EDF": ["robot12", "robot13"]}[how]
    inventory = part_of_lab(lab, robots, tmp_path / "lab.yml")
    path = tmp_path / "edited.edf"
    document = yaml.safe_load(pair("edited", *robots))
    path.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    before = traces(lab, robots)
    up = lab.srprov("apply", str(path), "-i", inventory, "--yes", "--settle", "0", "--json")
    assert up.code == 0, up
    made = {robot: set(lab.containers(robot)) for robot in robots}
    assert made == {robots[0]: {"srprov.edited.left"}, robots[1]: {"srprov.edited.right"}}

    which = [str(path)]
    if how == "renamed":
        document["services"]["west"] = document["services"].pop("left")
        document["services"]["west"]["robot"] = robots[1]
        path.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    elif how == "broken":
        path.write_text("edf: 1\nname: edited\nservices: {left: [image: ]: busybox\n\t- nonsense\n", encoding="utf-8")
        assert lab.srprov("validate", str(path)).code == 5
    else:
        path.unlink()
        which = ["--instance", "edited"]
    gone = lab.srprov("destroy", *which, "-i", inventory, "--yes", "--json")
    assert gone.code == 0, gone
    removed = [f"{robots[0]}/container:srprov.edited.left", f"{robots[1]}/container:srprov.edited.right"]
    assert changed(gone.json) > {*removed}
    assert traces(lab, robots) == before


def test_an_experiment_that_was_renamed_names_its_old_instance(lab_of_module: Lab, tmp_path: Path) -> None:
    """The new name owns nothing, so `destroy` takes nothing, and says under which name the same file made something."""
    lab, robots = lab_of_module, ["robot6", "robot7"]
    inventory = part_of_lab(lab, robots, tmp_path / "lab.yml")
    path = tmp_path / "named.edf"
    path.write_text(pair("old-name", *robots), encoding="utf-8")
    up = lab.srprov("apply", str(path), "-i", inventory, "--yes", "--settle", "0")
    assert up.code == 0, up
    there = traces(lab, robots)
    path.write_text(pair("new-name", *robots), encoding="utf-8")
    none = lab.srprov("destroy", str(path), "-i", inventory, "--yes", "--json")
    assert none.code == 0, none
    assert "old-name" in none.err and "--instance" in none.err
    assert none.json["steps"] == []
    assert traces(lab, robots) == there
    gone = lab.srprov("destroy", "--instance", "old-name", "-i", inventory, "--yes")
    assert gone.code == 0, gone
