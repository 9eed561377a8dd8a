"""What `--events` writes, line by line, as `srprov schema events` says; robots are in memory."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from srprov import data
from srprov.cli.main import run
from srprov.execution import Outcome
from tests.fakes import Fault, World
from tests.unit.cli.conftest import EDF

ROBOTS = ("-i", "inv.yml", "--yes")
SCHEMA = Draft202012Validator(data.schema("events"))


def events(file: str) -> list[dict[str, Any]]:
    """Return the events of a file, after holding each to the schema."""
    found = [json.loads(line) for line in Path(file).read_text(encoding="utf-8").splitlines()]
    for one in found:
        assert [problem.message for problem in SCHEMA.iter_errors(one)] == [], one
    return found


def about(event: dict[str, Any]) -> tuple[str, str | None]:
    """Return what happened, and of which step."""
    return event["event"], event["id"]


@pytest.fixture
def lines(world: World, capsys: pytest.CaptureFixture[str]) -> list[dict[str, Any]]:
    """Return the events of a build, an apply, one in which a step fails, the mending one, and the removal."""
    text = EDF
    for part in ("secrets: {key: {env: NOT_SET}}\n", ", secrets: [key]", ', volumes: ["log:/log"]'):
        text = text.replace(part, "")
    Path("e.edf").write_text(text)
    asked = ("e.edf", *ROBOTS, "--settle", "0.1")
    assert run(["build", "e.edf", *ROBOTS, "--events", "build"]) == 0
    capsys.readouterr()
    assert run(["apply", *asked, "--events", "first", "--json"]) == 0
    kept = json.loads(capsys.readouterr().out)["run"]
    recorded, written = events(f"{kept}/events.jsonl"), events("first")
    assert Counter((one["event"], one["id"]) for one in recorded) == Counter(
        (one["event"], one["id"]) for one in written
    )
    Path("e.edf").write_text(text.replace("alpine:3", "alpine:4"))
    world.fault = Fault(world.commands + 2)
    assert run(["apply", *asked, "--events", "second"]) != 0
    world.fault = None
    assert run(["apply", *asked, "--events", "third"]) == 0
    assert run(["destroy", "e.edf", *ROBOTS, "--events", "last"]) == 0
    return [one for name in ("build", "first", "second", "third", "last") for one in events(name)]


def test_every_event_of_whole_runs_fits_the_schema(lines: list[dict[str, Any]]) -> None:
    assert {one["event"] for one in lines} == set(data.schema("events")["properties"]["event"]["enum"])
    assert {one["outcome"] for one in lines} >= {"changed", "failed", None}


def test_the_schema_has_the_programs_own_outcomes() -> None:
    stated = data.schema("events")["properties"]["outcome"]["enum"]
    assert stated == [*(outcome.value for outcome in Outcome), None]


@pytest.mark.parametrize(
    "change",
    [{"more": 1}, {"event": "begin"}, {"outcome": None}, {"step": None}, {"id": None}, {"time": "now"},
     {"outcome": "done"}, {"duration_s": -1}, {"robot": None}],
    ids=str,
)  # fmt: skip
def test_what_no_run_writes_is_refused(change: dict[str, Any]) -> None:
    end = {
        "time": 1795468382.4, "event": "end", "robot": "r1", "step": 1, "id": "r1/volume:demo.log",
        "outcome": "changed", "text": "", "duration_s": 0.1,
    }  # fmt: skip
    assert SCHEMA.is_valid(end)
    assert not SCHEMA.is_valid({**end, **change})
