"""`srprov trials`, and what `srprov run` refuses before any robot is asked; robots are in memory."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from srprov import data
from srprov.cli.main import run
from srprov.cli.trial_session import show_report
from srprov.controller.trial_report import TrialsReport
from srprov.definitions.trialsmodel import Parameter, TrialDefinitions
from srprov.errors import RefusedError
from srprov.trials import design
from srprov.trials.judge import End
from srprov.trials.row import Seen, row
from tests.fakes import World

EDF = """\
edf: 1
name: race
services:
  a: {image: "alpine:3", robot: r1}
parameters: {SPEED: [1, 2]}
trials: {repetitions: 2, order: listed, timeout: 5s}
"""


@pytest.fixture
def race(world: World, tmp_path: Path) -> World:
    (tmp_path / "race.edf").write_text(EDF)
    return world


def test_trials_are_listed_without_an_inventory(race: World, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["trials", "race.edf"]) == 0
    head, *lines = capsys.readouterr().out.splitlines()
    assert head.split() == ["ORDER", "TRIAL", "POINT", "REPETITION", "SEED", "PARAMETERS"]
    assert [line.split()[-1] for line in lines] == ["SPEED=1", "SPEED=2"] * 2
    assert run(["trials", "race.edf", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert list(Draft202012Validator(data.schema("trials")).iter_errors(document)) == []
    assert [one["trial"] for one in document["trials"]] == [line.split()[1] for line in lines]
    assert race.log == [] and race.robots == {}, "no robot is asked"


@pytest.mark.parametrize(
    ("words", "text", "says"),
    [
        (["--only", "feedfeedfe-r001"], EDF, "there is no trial or point 'feedfeedfe-r001'"),
        (["-o", "race.edf/run"], EDF, "nothing can be kept in"),
        (["-o", "."], EDF, "is not empty"),
        (["--resume"], EDF, "--resume goes on with the run in a folder"),
        (["--resume", "-o", "nowhere"], EDF, "nowhere: No such file"),
        ([], EDF.replace("repetitions: 2", "exclude: [{SPEED: 1}, {SPEED: 2}]"), "no trial is left"),
        ([], EDF.replace("repetitions: 2", "between: {prompt: put it back}"), "a person is asked"),
    ],
)
def test_what_cannot_be_run_is_told_before_any_robot_is_asked(
    race: World, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], text: str, says: str
) -> None:
    (tmp_path / "race.edf").write_text(text)
    assert run(["run", "race.edf", "-i", "inv.yml", "--yes", *words]) in (5, RefusedError.exit_code)
    assert says in capsys.readouterr().err
    assert race.log == [] and race.robots == {}


def test_a_run_is_not_kept_in_what_its_experiment_ships(
    race: World, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """All steps were done on the robots before it was told that the run's own journal is a new file."""
    (tmp_path / "race.edf").write_text(EDF.replace("robot: r1", "robot: r1, volumes: ['.:/x:ro']"))
    assert run(["run", "race.edf", "-i", "inv.yml", "--yes", "-o", "res"]) == 5
    assert "the run would change its own experiment" in capsys.readouterr().err
    assert race.log == [] and race.robots == {} and not (tmp_path / "res").exists()
    assert run(["collect", "race.edf", "-i", "inv.yml", "-o", "res"]) != 0
    assert "warning: res is in " in capsys.readouterr().err


def test_the_status_of_trials_that_are_over_says_so(race: World, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["status", "race.edf", "-i", "inv.yml", "--exit-code"]) == 0
    told = capsys.readouterr()
    assert "note: race has trials, and none is under way: `srprov run` makes" in told.err
    assert "missing" not in told.out


@pytest.mark.parametrize("quiet", [True, False])
def test_a_quiet_run_that_asks_nothing_shows_no_plan(
    race: World, capsys: pytest.CaptureFixture[str], quiet: bool
) -> None:
    """It goes no further here: these robots in memory have no clocks."""
    run(["run", "race.edf", "-i", "inv.yml", "--yes", *["-q"] * quiet])
    assert race.robots, "robots were asked"
    assert ("Each trial makes these anew" in capsys.readouterr().out) is not quiet


def test_a_summary_counts_trials_and_names_those_that_were_tried_again(tmp_path: Path) -> None:
    made = design(TrialDefinitions(parameters=(Parameter(name="SPEED", values=("1", "2", "3")),)))
    first, second, _ = made.trials

    def ended(trial: object, attempt: int, status: str, **more: object) -> dict[str, object]:
        return {**row(trial, attempt, 1, Seen(end=End(status, "so it was"))), **more}  # type: ignore[arg-type]

    rows = [
        ended(first, 1, "infrastructure"),
        ended(first, 2, "ok", verdict="success", m_time=0.5, files=1, bytes=9, collect_s=0.1, controller_gap_s=0.0),
        ended(second, 1, "infrastructure"),
        ended(second, 2, "infrastructure"),
        {"trial": "feedfeedfe-r001", "attempt": 1, "status": "interrupted", "reason": "of an earlier design"},
    ]
    report = TrialsReport(folder=tmp_path, rows=rows, design=made, ended_early="")
    assert report.in_words() == [
        "1 of 3 trials count: 1 infrastructure; 1 ok, success; 1 not begun",
        f"tried again: {first.id} (2 attempts), {second.id} (2 attempts)",
    ]
    assert report.exit_code == 3
    document = json.loads(json.dumps(report.document))
    assert list(Draft202012Validator(data.schema("trials-run")).iter_errors(document)) == []
    assert len(document["rows"]) == 4


def test_a_run_whose_images_are_not_remembered_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`bundle --with-images` would say only that no run of this machine had them."""
    made = design(TrialDefinitions(parameters=(Parameter(name="SPEED", values=("1",)),)))
    for why in ("", "ran.json: no space left"):
        report = TrialsReport(folder=tmp_path, rows=(), design=made, ended_early="", forgetful=why)
        show_report(report, as_json=False)
        assert ("images of this run cannot be bundled: ran.json: no space left" in capsys.readouterr().err) is bool(why)


def test_a_table_that_is_not_there_is_not_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What comes before the first trial failed, and no folder was made."""
    made = design(TrialDefinitions(parameters=(Parameter(name="SPEED", values=("1",)),)))
    report = TrialsReport(folder=tmp_path / "run", rows=(), design=made, ended_early="")
    show_report(report, as_json=False)
    told = capsys.readouterr()
    assert told.out == "" and "read_csv" not in told.err
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "trials.csv").write_text("trial\n")
    show_report(report, as_json=False)
    told = capsys.readouterr()
    assert told.out == f"{tmp_path}/run/trials.csv\n" and "read_csv" in told.err
