"""What a person says of trials: some count no more, some are run again, changes are accepted. Robots are in memory."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from srprov import data
from srprov.cli.main import run
from srprov.controller.trial_files import Gathered
from srprov.controller.trial_outcome import Attempt, unjudged
from srprov.controller.trials import Trials
from srprov.execution.trial import TrialEnd
from srprov.record.journal import Journal
from srprov.trials.judge import End
from tests.fakes import World

EDF = """\
edf: 1
name: race
services: {a: {image: "alpine:3", robot: r1, command: [go]}}
parameters: {SPEED: [1, 2, 3]}
trials: {order: listed, timeout: 5s}
"""
WORDS = ("run", "race.edf", "-i", "inv.yml", "-o", "out", "--yes", "-q")
RESUME = (*WORDS, "--resume")


def done(_trials: Trials, one: Attempt, _tell: object) -> dict[str, object]:
    """Be a trial that ends well."""
    end = End("ok", "all services ended")
    return {**unjudged(one, TrialEnd(end=end), Gathered(), end), "verdict": "success"}


@pytest.fixture
def ids(world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[list[str]]:
    """Give the ids of three trials that were run; afterwards hold the whole journal to its schema."""
    (tmp_path / "race.edf").write_text(EDF)
    monkeypatch.setattr(Trials, "_done", done)
    assert run([*WORDS]) == 0
    world.log.clear()
    yield [row["trial"] for row in rows()]
    lines = [json.loads(line) for line in Path("out/journal.jsonl").read_text(encoding="utf-8").splitlines()]
    assert lines[0]["event"] == "run"
    assert [list(Draft202012Validator(data.schema("journal")).iter_errors(line)) for line in lines] == [[]] * len(lines)


def rows() -> list[dict[str, str]]:
    with Path("out/trials.csv").open(newline="") as stream:
        return list(csv.DictReader(stream))


def told() -> list[tuple[str, ...]]:
    return [(row["p_SPEED"], row["attempt"], row["status"], row["segment"]) for row in rows()]


def shown(capsys: pytest.CaptureFixture[str], *words: str) -> Any:
    capsys.readouterr()
    assert run([*words]) in (0, 3)
    document = json.loads(capsys.readouterr().out)
    assert list(Draft202012Validator(data.schema("trials-run")).iter_errors(document)) == []
    return document


def test_a_discarded_trial_counts_no_more_and_is_not_run(
    ids: list[str], world: World, capsys: pytest.CaptureFixture[str]
) -> None:
    before = rows()
    robots = len(world.log), world.commands
    assert run([*RESUME, "--discard", ids[1], "--reason", "somebody bumped, twice"]) == 0
    assert f"{ids[1]}: 1 discarded" in capsys.readouterr().err
    assert (len(world.log), world.commands) == robots, "no robot is asked"
    assert rows() == [
        before[0], {**before[1], "status": "discarded", "reason": "somebody bumped, twice"}, before[2],
    ]  # fmt: skip
    assert shown(capsys, "runs", "show", "out", "--json")["done"] == 2
    document = shown(capsys, *RESUME, "--json")
    assert (document["done"], [one["status"] for one in document["rows"]]) == (2, ["ok", "discarded", "ok"])
    assert told() == [("1", "1", "ok", "1"), ("2", "1", "discarded", "1"), ("3", "1", "ok", "1")]


def test_a_trial_is_run_again_and_what_it_gave_before_is_kept(ids: list[str]) -> None:
    assert run([*RESUME, "--discard", ids[0], "--reason", "bumped"]) == 0
    assert run([*RESUME, "--rerun", ids[0], "--rerun", ids[2], "--reason", "the lamp was off"]) == 0
    assert told() == [
        ("1", "1", "discarded", "1"), ("2", "1", "ok", "1"), ("3", "1", "discarded", "1"), ("1", "2", "ok", "1"),
        ("3", "2", "ok", "1"),
    ]  # fmt: skip
    assert [row["reason"] for row in rows()[:3]] == ["bumped", "all services ended", "the lamp was off"]
    assert run([*RESUME]) == 0
    assert len(rows()) == 5, "that was once"


def test_accepted_changes_begin_another_segment(
    ids: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    changed = EDF.replace("[go]", "[run]").replace("[1, 2, 3]", "[1, 2, 3, 4]")
    (tmp_path / "race.edf").write_text(changed)
    assert run([*RESUME]) == 9
    assert "--accept-changes goes on all the same" in capsys.readouterr().err
    assert run([*RESUME, "--accept-changes"]) == 0
    assert told() == [*((str(speed), "1", "ok", "1") for speed in (1, 2, 3)), ("4", "1", "ok", "2")]
    assert run([*RESUME]) == 0, "it is the present experiment from now on"
    (tmp_path / "race.edf").write_text(changed.replace("order: listed", "order: random, seed: 1"))
    assert run([*RESUME, "--accept-changes"]) == 9, "nobody can accept another order"
    (tmp_path / "race.edf").write_text(EDF)
    assert run([*RESUME]) == 9


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--discard", "ID", "--reason", "x"], "--discard is about a run that was begun"),
        (["--resume", "--discard", "ID"], "say why, for the table: --reason TEXT"),
        (["--resume", "--discard", "ID", "--reason", "x", "--rerun", "ID"], "--discard runs nothing"),
        (["--resume", "--discard", "feedfeedfe-r001", "--reason", "x"], "there is no trial or point"),
        (["--resume", "--rerun", "feedfeedfe-r001"], "there is no trial or point"),
        (["--accept-changes"], "--accept-changes is about a run that was begun"),
        (["--resume", "--reason", "x"], "--reason is why"),
    ],
)
def test_what_makes_no_sense_is_refused(
    world: World, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], says: str
) -> None:
    (tmp_path / "race.edf").write_text(EDF)
    assert run([*WORDS, *(word.replace("ID", "4e9ce07a82-r001") for word in words)]) == 5
    assert says in capsys.readouterr().err
    assert world.robots == {}


def test_two_at_once_in_a_folder_are_refused(ids: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    lines = len(Path("out/journal.jsonl").read_text().splitlines())
    with Journal(Path("out"), lines + 1):
        assert run([*RESUME, "--discard", ids[0], "--reason", "bumped"]) == 5
    assert "another srprov works in out" in capsys.readouterr().err
    assert run([*RESUME, "--discard", ids[0], "--reason", "bumped"]) == 0
