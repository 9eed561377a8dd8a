"""`--target`: the steps of some services and what they need; what others have stays, or the plan is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from srprov.cli.main import run
from tests.fakes import World

EDF = """\
edf: 1
name: demo
services:
  base: {image: "alpine:3", robot: r1}
  mid: {image: "alpine:3", robot: r2, depends_on: [base], volumes: ["log:/log"]}
  far: {image: "busybox:1", robot: r3, volumes: ["own:/own"]}
  twin: {image: "busybox:1", robot: r1, replicas: 2}
placement: {slots_per_robot: 4}
"""
WORDS = ("-i", "inv.yml", "--yes", "--settle", "0", "--no-probe")


@pytest.fixture
def three(world: World) -> World:
    Path("inv.yml").write_text("all: {hosts: {r1: {}, r2: {}, r3: {}}}\n")
    Path("e.edf").write_text(EDF)
    return world


def changed(old: str, new: str) -> None:
    text = Path("e.edf").read_text()
    assert old in text
    Path("e.edf").write_text(text.replace(old, new))


def planned(capsys: pytest.CaptureFixture[str], *words: str) -> dict[str, Any]:
    capsys.readouterr()
    assert run(["plan", "e.edf", "-i", "inv.yml", "--json", *words]) == 0
    document = json.loads(capsys.readouterr().out)
    assert isinstance(document, dict)
    return document


def ids(document: dict[str, Any], *kinds: str) -> list[str]:
    return [
        f"{one['robot']}/{one['module']}:{one['name'].rpartition('.')[2]}"
        for one in document["steps"]
        if not kinds or one["module"] in kinds
    ]


def containers(world: World) -> dict[str, list[str]]:
    return {name: sorted(robot["containers"]) for name, robot in world.state().items()}


def test_of_a_new_experiment_a_target_comes_with_what_it_depends_on(
    three: World, capsys: pytest.CaptureFixture[str]
) -> None:
    """And with nothing on robots that only others would use."""
    document = planned(capsys, "--target", "mid")
    assert ids(document, "container", "volume", "image") == [
        "r1/image:alpine:3", "r1/container:base", "r2/image:alpine:3", "r2/volume:log", "r2/container:mid",
    ]  # fmt: skip
    assert not [one for one in document["steps"] if one["robot"] == "r3"]
    assert any("far, twin-1, twin-2 stay as they are" in note for note in document["notes"])
    assert set(document["assignment"]) == {"base", "mid", "far", "twin-1", "twin-2"}
    assert run(["apply", "e.edf", *WORDS, "--target", "mid"]) == 0
    assert [sorted(one) for one in containers(three).values()] == [["srprov.demo.base"], ["srprov.demo.mid"], []]


def test_the_rest_follows_and_makes_the_experiment_whole(three: World, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["apply", "e.edf", *WORDS, "--target", "mid"]) == 0
    before = {name: robot["containers"] for name, robot in three.state().items()}
    assert run(["apply", "e.edf", *WORDS]) == 0
    after = {name: robot["containers"] for name, robot in three.state().items()}
    assert all(after[robot][name] == one for robot, some in before.items() for name, one in some.items())
    assert run(["plan", "e.edf", "-i", "inv.yml", "--detailed-exitcode"]) == 0


def test_what_changed_on_others_is_left(three: World, capsys: pytest.CaptureFixture[str]) -> None:
    """Of a change on two services one is made; the other is the next plan's."""
    assert run(["apply", "e.edf", *WORDS]) == 0
    changed('base: {image: "alpine:3"', 'base: {environment: {A: "1"}, image: "alpine:3"')
    changed('far: {image: "busybox:1"', 'far: {environment: {A: "1"}, image: "busybox:1"')
    document = planned(capsys, "--target", "far")
    assert ids(document) == ["r3/container:far"]
    assert any("base stays as it is" in note for note in document["notes"])
    before = three.state()["r1"]
    assert run(["apply", "e.edf", *WORDS, "--target", "far"]) == 0
    assert three.state()["r1"] == before
    assert ids(planned(capsys)) == ["r1/container:base"]


def test_others_learn_where_a_new_service_is(three: World, capsys: pytest.CaptureFixture[str]) -> None:
    """Robots that run something get the hosts file and the link's table; their containers stay."""
    assert run(["apply", "e.edf", *WORDS]) == 0
    before = three.state()
    changed("  twin:", '  late: {image: "alpine:3", robot: r2}\n  twin:')
    document = planned(capsys, "--target", "late")
    assert "r2/container:late" in ids(document)
    assert {"file", "vxlan"} <= {one["module"] for one in document["steps"] if one["robot"] == "r3"}
    assert run(["apply", "e.edf", *WORDS, "--target", "late"]) == 0
    assert three.state()["r3"]["containers"] == before["r3"]["containers"]


@pytest.mark.parametrize(
    ("words", "names"),
    [
        (["twin"], ["twin-1", "twin-2"]),
        (["twin-2"], ["twin-2"]),
        (["twin@r1"], ["twin-1", "twin-2"]),
        (["far", "twin-1"], ["far", "twin-1"]),
    ],
)
def test_words_mean_what_they_mean_elsewhere(
    three: World, capsys: pytest.CaptureFixture[str], words: list[str], names: list[str]
) -> None:
    document = planned(capsys, *(part for word in words for part in ("--target", word)))
    assert sorted(one.rpartition(":")[2] for one in ids(document, "container")) == names


@pytest.mark.parametrize(
    ("word", "said"),
    [("nobody", "no service 'nobody'"), ("far@r1", "far is not placed on 'r1'"), ("fax", "did you mean 'far'?")],
)
def test_a_word_that_means_nothing_is_refused(
    three: World, capsys: pytest.CaptureFixture[str], word: str, said: str
) -> None:
    assert run(["plan", "e.edf", "-i", "inv.yml", "--target", word]) == 5
    assert said in capsys.readouterr().err


def test_a_service_that_would_move_or_go_is_not_passed_over(three: World, capsys: pytest.CaptureFixture[str]) -> None:
    """Others would look for it where it is not."""
    assert run(["apply", "e.edf", *WORDS]) == 0
    changed('far: {image: "busybox:1", robot: r3, volumes: ["own:/own"]}', 'far: {image: "busybox:1", robot: r2}')
    assert run(["plan", "e.edf", "-i", "inv.yml", "--data", "leave", "--target", "base"]) == 9
    assert "far is to go from r3 to r2" in capsys.readouterr().err
    assert run(["plan", "e.edf", "-i", "inv.yml", "--data", "leave", "--target", "base", "--target", "far"]) == 0
    changed('  far: {image: "busybox:1", robot: r2}\n', "")
    assert run(["apply", "e.edf", *WORDS, "--target", "base"]) == 9
    said = capsys.readouterr().err
    assert "far is not in the experiment any more" in said and "--target far" in said
    assert run(["apply", "e.edf", *WORDS, "--target", "far"]) == 0
    assert containers(three)["r3"] == []


def test_a_network_that_must_be_made_anew_is_no_targets_business(
    three: World, capsys: pytest.CaptureFixture[str]
) -> None:
    """All containers on it would go and come."""
    assert run(["apply", "e.edf", *WORDS]) == 0
    Path("e.edf").write_text(Path("e.edf").read_text() + "network: {subnet: 10.77.0.0/16}\n")
    assert run(["plan", "e.edf", "-i", "inv.yml", "--target", "far"]) == 9
    assert "--target would also touch" in capsys.readouterr().err


def test_a_plan_file_keeps_its_targets(three: World, capsys: pytest.CaptureFixture[str]) -> None:
    """It is derived again when it is applied, and is the same part of the whole."""
    assert run(["apply", "e.edf", *WORDS]) == 0
    changed('base: {image: "alpine:3"', 'base: {environment: {A: "1"}, image: "alpine:3"')
    changed('far: {image: "busybox:1"', 'far: {environment: {A: "1"}, image: "busybox:1"')
    assert run(["plan", "e.edf", "-i", "inv.yml", "--target", "far", "-o", "plan.json"]) == 0
    saved = json.loads(Path("plan.json").read_text())
    assert saved["targets"] == ["far"] and ids(saved) == ["r3/container:far"]
    before = three.state()["r1"]
    assert run(["apply", "plan.json", *WORDS, "--target", "far"]) == 5
    assert run(["apply", "plan.json", *WORDS]) == 0, capsys.readouterr().err
    assert three.state()["r1"] == before
    assert ids(planned(capsys)) == ["r1/container:base"]
    Path("plan.json").write_text(json.dumps({**saved, "targets": ["base"]}, indent=2) + "\n")
    assert run(["apply", "plan.json", *WORDS]) != 0
