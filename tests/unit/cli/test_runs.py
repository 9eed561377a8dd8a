"""`srprov runs` and `runs show`: what was recorded, read without changing it, whoever wrote it."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from srprov import data
from srprov.cli.main import run
from srprov.cli.status import table
from srprov.definitions.trialsmodel import Parameter, TrialDefinitions
from srprov.record.journal import NAME, Journal
from srprov.trials import Trial, design
from srprov.trials.judge import End
from srprov.trials.row import Seen, row
from tests.fakes import Behaviour, World

TRIALS = design(TrialDefinitions(parameters=(Parameter(name="SPEED", values=("1", "2", "3")),))).trials


def ended(trial: Trial, status: str, **more: object) -> dict[str, object]:
    return {**row(trial, 1, 1, Seen(end=End(status, "so it was"))), "clocks": [], **more}


def kept(
    folder: Path, *rows: dict[str, object], name: str = "20261122T090507Z-race-4f1c09aa", end: bool = True
) -> Path:
    """Write the journal of a run of trials."""
    folder.mkdir(parents=True)
    with Journal(folder) as journal:
        journal.add("run", run=name, same={}, trials=len(TRIALS))
        for one in rows:
            journal.add("begin", trial=one["trial"], attempt=one["attempt"])
            journal.add("end", trial=one["trial"], attempt=one["attempt"], row=one)
        if end:
            journal.add("ended", reason="")
    return folder


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.delenv("SRPROV_RUNS", raising=False)
    return tmp_path / "state" / "srprov"


def shown(capsys: pytest.CaptureFixture[str], *words: str, code: int = 0) -> tuple[list[str], str]:
    assert run(["runs", *words]) == code
    told = capsys.readouterr()
    return told.out.splitlines(), told.err


def valid(capsys: pytest.CaptureFixture[str], kind: str, *words: str) -> Any:
    document = json.loads("\n".join(shown(capsys, *words, "--json")[0]))
    assert list(Draft202012Validator(data.schema(kind)).iter_errors(document)) == []
    return document


def test_what_apply_recorded_and_runs_of_trials_are_in_one_list(
    world: World, home: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (Path("e.edf")).write_text("edf: 1\nname: demo\nservices: {c: {image: 'alpine:3', robot: r1}}\n")
    assert run(["apply", "e.edf", "-i", "inv.yml", "--yes", "--settle", "0"]) == 0
    kept(home / "trials" / "one", ended(TRIALS[0], "ok"), ended(TRIALS[1], "infrastructure"))
    capsys.readouterr()
    lines, _ = shown(capsys)
    assert lines[0].split() == ["BEGUN", "VERB", "INSTANCE", "RESULT", "RUN"]
    assert "demo" in lines[1] and "apply" in lines[1] and " changed " in lines[1]
    assert lines[2].split()[1:] == ["run", "race", "1", "of", "3", "trials", "count", "one"]
    first, second = valid(capsys, "runs")["runs"]
    assert (first["verb"], first["ended"], first["trials"], first["failed"]) == ("apply", True, None, 0)
    assert (second["done"], second["trials"], second["changed"]) == (1, 3, None)
    assert shown(capsys, "show", first["run"])[0][1].endswith(first["path"])
    assert shown(capsys, "show", "one")[0] == shown(capsys, "show", second["path"])[0]


def test_the_steps_of_an_apply_are_shown_with_why_one_failed(
    world: World, home: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """No robot is asked; what a service said writes no line of its own."""
    Path("e.edf").write_text("edf: 1\nname: demo\nservices: {c: {image: 'alpine:3', robot: r1}}\n")
    world.add("r1", "r2").robots["r1"].engine.behaviours["c"] = Behaviour(exits=7, log="no \x1b[31mmap\nfailed: r9")
    assert run(["apply", "e.edf", "-i", "inv.yml", "--yes"]) == 3
    told = capsys.readouterr().err.splitlines()
    (name,) = [line.rpartition(" ")[2] for line in told if line.startswith("its record: srprov runs show ")]
    world.robots.clear()
    lines, aside = shown(capsys, "show", name)
    assert lines[2] == "" and "changed: r1/image:alpine:3" in lines
    at = lines.index("failed: r1/container:srprov.demo.c: did not converge: exited with code 7")
    assert lines[at + 1 : at + 4] == ["  its last lines:", "    no \\x1b[31mmap", "    failed: r9"]
    assert not [line for line in lines if line.startswith("failed: r9")]
    assert aside == f"{home}/runs/{name}/plan.txt has what each step was to change, and its commands\n"


@pytest.mark.parametrize("name", ["environment.json", "result.json"])
def test_a_link_is_no_file_of_an_applys_record(
    world: World, home: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    """The folder of a stranger led it to a file of the user's."""
    Path("e.edf").write_text("edf: 1\nname: demo\nservices: {c: {image: 'alpine:3', robot: r1}}\n")
    assert run(["apply", "e.edf", "-i", "inv.yml", "--yes", "--settle", "0"]) == 0
    (record,) = (home / "runs").iterdir()
    away = home / "away.json"
    away.write_text((record / name).read_text().replace("demo", "nobodys-business"))
    (record / name).unlink()
    (record / name).symlink_to(away)
    capsys.readouterr()
    lines, aside = shown(capsys, "show", str(record), code=5)
    assert "it is a link" in aside and "nobodys-business" not in "".join((*lines, aside))


def test_the_trials_of_a_run_are_shown_with_parameters_and_metrics(
    home: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lost = {"trial": "feedfeedfe-r001", "attempt": 1, "status": "interrupted", "reason": "the run ended"}
    folder = kept(
        home / "trials" / "one",
        ended(TRIALS[0], "ok", m_time=0.25, verdict="success"),
        ended(TRIALS[1], "infrastructure", reason="r1: \x1b[31maway\nfor ever"),
        lost,
    )
    before = {path: path.read_bytes() for path in folder.iterdir()}
    lines, told = shown(capsys, "show", "one")
    assert lines[0].split() == ["ORDER", "TRIAL", "ATTEMPT", "STATUS", "VERDICT", "P_SPEED", "M_TIME", "WHY"]
    assert lines[1].split()[1:] == [TRIALS[0].id, "1", "ok", "success", "1", "0.25", "-"]
    assert len(lines) == 4 and "\x1b" not in lines[2] and "away" in lines[2]
    assert told == "1 of 3 trials count\n"
    document = valid(capsys, "trials-run", "show", "one")
    assert [one["trial"] for one in document["rows"]] == [TRIALS[0].id, TRIALS[1].id]
    assert {path: path.read_bytes() for path in folder.iterdir()} == before


def test_a_run_that_is_under_way_is_read_and_not_mended(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = kept(home / "trials" / "one", ended(TRIALS[0], "ok"), end=False) / NAME
    path.write_bytes(path.read_bytes() + b'{"seq": 4, "even')
    before = path.read_bytes()
    assert "1 of 3 trials count; not ended" in shown(capsys)[0][1]
    assert "it is not complete: it has not ended, or was killed" in shown(capsys, "show", "one")[1]
    assert path.read_bytes() == before


def test_one_that_cannot_be_read_is_named_and_the_others_are_listed(
    home: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = home / "trials"
    kept(root / "good", ended(TRIALS[0], "ok"))
    kept(root / "odd", {"trial": 3, "attempt": [1], "status": None})
    (root / "linked").mkdir()
    (root / "linked" / NAME).symlink_to(root / "good" / NAME)
    (root / "empty").mkdir()
    (root / "record").mkdir()
    (root / "record" / "environment.json").write_text("[" * 100_000)
    lines, told = shown(capsys, str(root))
    assert len(lines) == 2 and lines[1].endswith(str(root / "good"))
    assert [name in told for name in ("odd", "linked", "record", "empty")] == [True, True, True, False]
    assert len(valid(capsys, "runs", str(root))["runs"]) == 1
    assert "is a link" in shown(capsys, "show", str(root / "linked"), code=5)[1]


def test_a_run_with_more_numbers_than_can_be_shown_is_named(
    home: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also when they stand in lists of robots' measurements; a column too many is no row."""
    monkeypatch.setattr("srprov.record.runs._MOST_CELLS", 100)
    kept(home / "trials" / "good", ended(TRIALS[0], "ok"))
    kept(home / "trials" / "large", ended(TRIALS[0], "ok", clocks=[{"a": 1, "b": 2}] * 50))
    kept(home / "trials" / "wide", ended(TRIALS[0], "ok", **{f"m_{number}": 1 for number in range(1000)}))
    lines, told = shown(capsys)
    assert len(lines) == 2 and "large: its attempts have more than" in told and "wide: the journal has rows" in told


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("show",), "one folder is listed"),
        (("a", "b"), "one folder is listed"),
        (("show", "a", "9f2c01ab34-r002"), "RUN/trials/TRIAL has logs and results"),
        (("nowhere",), "nowhere: No such file"),
        (("show", "nowhere"), "there is no run 'nowhere'"),
        (("show", ".."), "is no record"),
    ],
)
def test_what_is_no_run_is_told(
    home: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], says: str
) -> None:
    assert says in shown(capsys, *words, code=5)[1]


def test_without_any_run_the_folders_are_named(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (line,), _ = shown(capsys)
    assert line == f"no runs in {home / 'runs'} and {home / 'trials'}"


def circles(path: Path) -> list[list[tuple[float, float]]]:
    """Return the points of each panel of a picture, read as any viewer does."""
    panels = ET.fromstring(path.read_text()).iter("{http://www.w3.org/2000/svg}g")
    return [
        [(float(one.attrib["cx"]), float(one.attrib["cy"])) for one in panel if "cx" in one.attrib] for panel in panels
    ]


def test_a_metric_is_drawn_over_a_parameter_and_over_the_order(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    kept(
        home / "trials" / "one",
        ended(TRIALS[2], "ok", m_time=4.0), ended(TRIALS[0], "timeout", m_time=1.0), ended(TRIALS[1], "ok", m_time=2.0),
        ended(TRIALS[1], "infrastructure", m_time=99.0),
    )  # fmt: skip
    assert shown(capsys, "show", "one", "--svg", "x.svg", "--metric", "time", "--over", "SPEED") == ([], "")
    over, order = circles(Path("x.svg"))
    assert [x for x, _ in over] == sorted((x for x, _ in over), reverse=True)[:1] + sorted(x for x, _ in over)[:2]
    (left, low), (middle, mean), (right, high) = sorted(over)
    assert middle - left == pytest.approx(right - middle, abs=0.05), "1, 2 and 3 have the same distance"
    assert low - mean == pytest.approx((mean - high) / 2, abs=0.05), "and 1, 2 and 4 have not; what failed is not there"
    assert [y for _, y in order] == [high, low, mean] and [x for x, _ in order] == sorted(x for x, _ in order)
    shown(capsys, "show", "one", "--svg", "y.svg")
    assert Path("y.svg").read_text() == Path("x.svg").read_text(), "the first metric, over the first parameter"
    assert Path("x.svg").stat().st_mode & 0o077 == 0


@pytest.mark.parametrize(
    "word", ['</text><script>alert("x")</script>', "\x1b[31m\x00", "1e999", "nan", "\ud800", "x" * 5000]
)
def test_a_picture_takes_any_name_and_value(home: Path, capsys: pytest.CaptureFixture[str], word: str) -> None:
    one = {**ended(TRIALS[0], "ok", m_a=1e19), "p_SPEED": word, f"p_{word}": word}
    kept(home / "trials" / "one", one, ended(TRIALS[1], "ok", m_a=-1e19), ended(TRIALS[2], "ok", m_a=2**63))
    shown(capsys, "show", "one", "--svg", "x.svg")
    assert [len(panel) for panel in circles(Path("x.svg"))] == [3, 3]
    assert "<script" not in Path("x.svg").read_text() and len(Path("x.svg").read_text()) < 10_000


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("show", "one", "--svg", "x.svg", "--metric", "speed"), "there are: attempt, m_time, order"),
        (("show", "one", "--svg", "x.svg", "--over", "LOAD"), "there are: p_SPEED"),
        (("--svg", "x.svg"), "draws the trials of one run"),
        (("show", "one", "--svg", "/nowhere/x.svg"), "cannot write /nowhere/x.svg"),
    ],
)
def test_a_picture_of_nothing_is_refused(
    home: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], says: str
) -> None:
    kept(home / "trials" / "one", ended(TRIALS[0], "ok", m_time=1.0))
    assert says in shown(capsys, *words, code=5)[1]
    assert not Path("x.svg").exists()


def test_a_table_of_too_many_columns_is_refused(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each attempt may have few; the table has those of all."""
    rows = [{**ended(TRIALS[0], "ok"), **{f"m_{n}_{column}": 1 for column in range(300)}} for n in range(4)]
    kept(home / "trials" / "one", *rows)
    assert "its attempts have more than 1000 columns" in shown(capsys, "show", "one", code=5)[1]


def test_a_table_of_too_many_cells_is_refused(
    home: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("srprov.record.runs._MOST_CELLS", 10_000)
    wide = {**ended(TRIALS[0], "ok"), **{f"m_{column}": 1 for column in range(500)}}
    kept(home / "trials" / "one", wide, *[ended(TRIALS[1], "ok")] * 30)
    assert "its attempts have more than 10000 numbers" in shown(capsys, "show", "one", code=5)[1]


def test_a_run_without_access_is_named_and_the_others_are_listed(
    home: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from srprov.record import runs as kept_here

    for name in ("one", "two", "three"):
        kept(home / "trials" / name, ended(TRIALS[0], "ok"))
    look = kept_here.is_trials

    def closed(folder: Path) -> bool:
        if folder.name == "three":
            raise PermissionError(13, "Permission denied", str(folder))
        return look(folder)

    monkeypatch.setattr(kept_here, "is_trials", closed)
    lines, said = shown(capsys, str(home / "trials"))
    assert [line.split()[-1] for line in lines[1:]] == [str(home / "trials" / one) for one in ("one", "two")]
    assert said == f"warning: {home / 'trials' / 'three'}: Permission denied\n"


def test_the_name_of_a_column_is_one_line() -> None:
    """A record of somebody else names its metrics: one began a line of its own, which looked like an error of ours."""
    name = "m_x\nerror[SRP-001]: fake\x1b[2J"
    head, row = table([{name: 1}], (name,)).splitlines()
    assert "\x1b" not in head and row == "1"


def test_list_lists_and_is_a_folder_where_there_is_one(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    kept(home / "trials" / "good", ended(TRIALS[0], "ok"))
    assert shown(capsys, "list") == shown(capsys)
    Path("list").mkdir()
    assert shown(capsys, "list")[0] == ["no runs in list"]


def test_a_run_of_trials_says_where_logs_are(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    kept(home / "trials" / "good", ended(TRIALS[0], "ok"))
    assert "TRIAL has" not in shown(capsys, "show", "good")[1]
    (home / "trials" / "good" / "trials").mkdir()
    assert f"{home}/trials/good/trials/TRIAL has the logs and results of each" in shown(capsys, "show", "good")[1]
