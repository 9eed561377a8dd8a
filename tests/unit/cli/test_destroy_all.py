"""`destroy --all-instances`: what is listed, asked and removed, and what never is."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import pytest

from srprov.cli.main import run
from srprov.record.memory import Memory, remember
from tests.fakes import World

EDF = "edf: 1\nname: demo\nservices: {a: {image: 'alpine:3', robot: r1, volumes: ['log:/log']}}\n"
HOW = ("-i", "inv.yml", "--yes", "--settle", "0", "--no-probe")
RECORD = "/var/lib/srprov/theirs/placement.json"
ALL = ("destroy", "-i", "inv.yml", "--all-instances")


@pytest.fixture
def three(world: World, monkeypatch: pytest.MonkeyPatch) -> World:
    """Two instances of one file, and one of another."""
    monkeypatch.setattr("srprov.controller.kept.with_sizes", lambda rows, *_: list(rows))  # fakes have no sizes
    Path("e.edf").write_text(EDF)
    Path("other.edf").write_text(EDF.replace("demo", "theirs").replace("r1", "r2"))
    assert run(["apply", "e.edf", *HOW]) == 0
    assert run(["apply", "e.edf", *HOW, "--instance", "second"]) == 0
    assert run(["apply", "other.edf", *HOW]) == 0
    return world


def there(world: World) -> list[str]:
    return sorted(name for robot in world.state().values() for name in robot["containers"])


def volumes(world: World) -> list[str]:
    return sorted(name for robot in world.state().values() for name in robot["volumes"])


EVERY = ["srprov.demo.a", "srprov.second.a", "srprov.theirs.a"]


def test_all_are_listed_with_who_made_them_and_removed(three: World, capsys: pytest.CaptureFixture[str]) -> None:
    """Data stays; nothing else does."""
    assert there(three) == EVERY
    capsys.readouterr()
    assert run([*ALL, "--yes", "--quiet"]) == 0
    said = capsys.readouterr()
    header, *rows = said.out.splitlines()
    assert header.split() == ["INSTANCE", "MADE", "FROM", "ROBOTS", "CONTAINERS", "VOLUMES"]
    assert [row.split()[0] for row in rows] == ["demo", "second", "theirs"]
    assert "/other.edf" in rows[2] and "r2" in rows[2].split()
    assert there(three) == [] and len(volumes(three)) == 3
    assert "data stays: " in said.err
    assert ": 0 changed, " in said.err and " removed, " in said.err, "what was taken away is not called changed"
    assert run([*ALL, "--yes"]) == 0
    assert "VOLUMES" in capsys.readouterr().out, "what keeps data is still an instance's"


def test_with_a_file_those_of_the_file(three: World, capsys: pytest.CaptureFixture[str]) -> None:
    assert run([*ALL, "e.edf", "--yes"]) == 0
    assert there(three) == ["srprov.theirs.a"]
    assert "another file made theirs" in capsys.readouterr().err
    assert run([*ALL, "e.edf", "--yes", "--adopt"]) == 0
    assert there(three) == []


def test_a_robot_that_says_that_the_file_made_another_s_takes_nothing_from_others(
    three: World, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whoever is root on it knows the source, which stands on what it has of the file. Another machine made theirs."""
    remember("theirs", Memory())
    r1, r2 = three.robots["r1"], three.robots["r2"]
    mine = r1.engine.containers["srprov.demo.a"]
    body = {
        "Image": "x",
        "HostConfig": {},
        "Labels": {**mine.body["Labels"], "srprov.instance": "theirs", "srprov.service": "w"},
    }
    r1.engine.containers["srprov.theirs.w"] = replace(mine, name="srprov.theirs.w", body=body)
    said = json.loads(r1.disk.files[RECORD]) | {"serial": 900, "robots": {"r1": {}}, "services": {}}
    said["source"] = body["Labels"]["srprov.source"]
    r1.disk.files[RECORD] = json.dumps(said).encode()
    assert run([*ALL, "e.edf", "--yes"]) == 9
    assert "srprov.theirs.a" in r2.engine.containers
    assert "instance 'theirs' on r2 was made from" in capsys.readouterr().err


def test_one_question_names_all(three: World, capsys: pytest.CaptureFixture[str], monkeypatch: Any) -> None:
    asked: list[str] = []

    def confirm(question: str, **_: object) -> bool:
        asked.append(question)
        return False

    monkeypatch.setattr(click, "confirm", confirm)
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    assert run([*ALL, "--volumes", "--adopt"]) == 9
    assert asked == ["Destroy demo, second, theirs on 2 robots? The data of 3 volumes is lost."]
    assert there(three) == EVERY
    capsys.readouterr()


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["--instance", "demo"], 5, "--all-instances does not go with --instance"),
        (["--json"], 5, "--events FILE has each run"),
        (["--volumes"], 9, "remove data of whoever made it"),
    ],
)
def test_what_does_not_go_with_it_is_refused(
    three: World, capsys: pytest.CaptureFixture[str], words: list[str], code: int, said: str
) -> None:
    assert run([*ALL, "--yes", *words]) == code
    assert said in capsys.readouterr().err
    assert there(three) == EVERY


def test_nobody_to_ask_is_a_no(three: World, capsys: pytest.CaptureFixture[str]) -> None:
    assert run([*ALL]) == 9
    assert there(three) == EVERY


def test_data_goes_when_it_is_said(three: World) -> None:
    """With the file, those that it made; without, only with --adopt."""
    assert run([*ALL, "e.edf", "--yes", "--volumes"]) == 0
    assert volumes(three) == ["srprov.theirs.log"]
    assert run([*ALL, "--yes", "--volumes", "--adopt"]) == 0
    assert volumes(three) == []


def test_limit_chooses_robots(three: World) -> None:
    assert run([*ALL, "--yes", "--limit", "r2"]) == 0
    assert there(three) == ["srprov.demo.a", "srprov.second.a"]


def test_where_nothing_is_nothing_is_asked(world: World, capsys: pytest.CaptureFixture[str]) -> None:
    assert run([*ALL, "--yes"]) == 0
    assert "no instance to destroy" in capsys.readouterr().err
