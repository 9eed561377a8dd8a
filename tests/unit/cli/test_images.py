"""`srprov images` and `images prune` as users call them, with robots in memory."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from srprov import data
from srprov.cli.main import run
from srprov.transport.blobs import Blobs
from tests.fakes import FakeLockChannel, World
from tests.unit.cli.conftest import CDF

ALLOWED = ("-i", "inv.yml", "--allow", "secret")
OURS = {"srprov.cdf": "a", "srprov.instance": ""}
OLD, STRANGE = "srprov/a:0123456789abcdef", "srprov/other:0123456789abcdef"


@pytest.fixture
def stocked(world: World, capsys: pytest.CaptureFixture[str]) -> World:
    """Give robots with what is built ahead, what is old, what is of another experiment, and a base."""
    assert run(["build", "e.edf", *ALLOWED, "--yes"]) == 0
    for robot in world.robots.values():
        robot.engine.images |= {name: OURS for name in (*robot.engine.images, OLD, STRANGE) if "srprov/" in name}
        robot.engine.images["busybox:latest"] = {}
    capsys.readouterr()
    return world


def left(world: World) -> dict[str, set[str]]:
    return {name: {one for one in robot.engine.images if "srprov/" in one} for name, robot in world.robots.items()}


def test_the_list_says_who_uses_what_and_fits_its_schema(stocked: World, capsys: pytest.CaptureFixture[str]) -> None:
    """FILE leaves the images of its own definitions; neither changes anything."""
    before = stocked.state()
    assert run(["images", "-i", "inv.yml", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert list(Draft202012Validator(data.schema("images")).iter_errors(told)) == []
    named = {one["tags"][0]: one["named_by"] for one in told["robots"]["r1"]["images"]}
    (ahead,) = named.keys() - {OLD, STRANGE}
    assert named == {ahead: ["demo"], OLD: [], STRANGE: []} and told["cache"]["bytes"] == 0
    assert run(["images", "e.edf", "-i", "inv.yml", "--limit", "r1"]) == 0
    text = capsys.readouterr().out
    assert "the last run of demo" in text and "nobody" in text and STRANGE not in text and "r2" not in text
    assert stocked.state() == before


def test_what_nobody_uses_goes_and_what_was_built_ahead_stays(
    stocked: World, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of one experiment, then all; a second time there is nothing. What was removed is no name that keeps it."""
    assert run(["images", "prune", "e.edf", "-i", "inv.yml", "--yes", "--json"]) == 0
    done = json.loads(capsys.readouterr().out)
    assert list(Draft202012Validator(data.schema("run")).iter_errors(done)) == []
    assert [step["id"] for step in done["steps"]] == [f"r1/image:{OLD}", f"r2/image:{OLD}"]
    assert all(STRANGE in one and len(one) == 2 for one in left(stocked).values())
    for robot in stocked.robots.values():
        robot.engine.images[OLD] = OURS
    assert run(["images", "prune", "-i", "inv.yml", "--limit", "r2", "--yes"]) == 0
    told = capsys.readouterr()
    assert OLD in told.out and "r2: 2 images, " in told.out and "1 image of srprov's stays" in told.out
    assert "\nimages: done in " in told.err and ".images" not in told.err
    assert {name: len(one) for name, one in left(stocked).items()} == {"r1": 3, "r2": 1}
    assert run(["images", "prune", "-i", "inv.yml", "--limit", "r2", "--yes", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["steps"] == []
    assert all("busybox:latest" in robot.engine.images for robot in stocked.robots.values())


def test_the_last_run_decides_and_a_destroy_names_nothing(
    stocked: World, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Containers that run keep theirs, whatever the last run named."""
    monkeypatch.setenv("NOT_SET", "a value of some length")
    assert run(["apply", "e.edf", *ALLOWED, "--yes", "--settle", "0"]) == 0
    (running,) = left(stocked)["r1"] - {OLD, STRANGE}
    Path("a.cdf").write_text(CDF.format(word="two"))
    assert run(["build", "e.edf", *ALLOWED, "--yes"]) == 0
    for robot in stocked.robots.values():
        robot.engine.images |= {name: OURS for name in robot.engine.images if "srprov/" in name}
    assert run(["images", "prune", "e.edf", "-i", "inv.yml", "--yes"]) == 0
    assert all(running in one and len(one) == 3 for one in left(stocked).values())
    assert run(["destroy", "e.edf", "-i", "inv.yml", "--yes", "--volumes"]) == 0
    assert run(["images", "prune", "-i", "inv.yml", "--yes"]) == 0
    assert left(stocked) == {"r1": set(), "r2": set()}


def test_nothing_goes_unasked_or_while_somebody_else_has_the_robot(
    stocked: World, capsys: pytest.CaptureFixture[str]
) -> None:
    """A robot that is away is told, and the others go on."""
    before = left(stocked)
    assert run(["images", "prune", "-i", "inv.yml"]) == 9
    assert run(["images", "prune", "a", "b", "-i", "inv.yml", "--yes"]) == 5
    stocked.robots["r1"].holder = FakeLockChannel(stocked.robots["r1"], json.dumps({"owner": "anna@desk", "pid": 1}))
    assert run(["images", "prune", "-i", "inv.yml", "--yes"]) == 7
    assert "anna@desk" in capsys.readouterr().err and left(stocked) == before
    stocked.robots["r1"].holder, stocked.robots["r1"].gone = None, True
    assert run(["images", "-i", "inv.yml"]) == 4
    assert run(["images", "prune", "-i", "inv.yml", "--yes"]) == 4
    assert "unreachable: r1" in capsys.readouterr().err
    assert len(left(stocked)["r2"]) == 1 and left(stocked)["r1"] == before["r1"]


def test_a_record_that_cannot_be_read_keeps_everything(stocked: World, capsys: pytest.CaptureFixture[str]) -> None:
    """Nobody knows what it names."""
    before = left(stocked)
    (record,) = Path("home/srprov/runs").iterdir()
    (record / "plan.json").write_text("[")
    assert run(["images", "prune", "-i", "inv.yml", "--yes"]) == 5
    assert record.name in capsys.readouterr().err and left(stocked) == before


def test_the_cache_is_told_and_emptied_where_it_is_asked_for(
    world: World, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Layers alone: what else lies in the folder is not ours, and what is being written is in use."""
    cache = Blobs()
    content = b"x" * 1000
    cache.add_content(f"sha256:{hashlib.sha256(content).hexdigest()}", [content])
    for name in ("notes.txt", "half.part"):
        (cache.folder / name).write_text("x")
    assert run(["images", "-i", "inv.yml", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["cache"]
    assert told == {"folder": str(cache.folder), "bytes": cache.total()} and cache.total() > 0
    assert run(["images", "prune", "-i", "inv.yml", "--yes"]) == 0 and cache.total() == told["bytes"]
    assert run(["images", "prune", "-i", "inv.yml", "--yes", "--cache"]) == 0
    assert {one.name for one in cache.folder.iterdir()} == {"notes.txt", "half.part"}
