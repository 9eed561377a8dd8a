"""Two runs are compared: what is changed is named in its section, and in no other."""

from __future__ import annotations

import json
import random
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from srprov import data
from srprov.cli.main import run as cli
from srprov.definitions.trialsmodel import Margin
from srprov.errors import UsageError
from srprov.evidence.compare import Comparison, compare
from tests.trial_folders import FILES, run_folder, write_experiment
from tests.unit.evidence.bundles import Content, packed

Row = dict[str, Any]
TEN = {**FILES, "race.edf": FILES["race.edf"].replace("repetitions: 2", "repetitions: 10")}


@pytest.fixture(scope="module")
def long(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run of two points, ten trials each."""
    home = tmp_path_factory.mktemp("long")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(home / "state"))
        return run_folder(home / "run", write_experiment(home / "experiment", TEN), failed=0)


def graded(found: Comparison) -> dict[str, str]:
    """Return the grade of each section that is not identical."""
    return {one.id: one.grade for one in found.sections if one.grade != "identical"}


def lines(found: Comparison, section: str) -> dict[str, str]:
    """Return what is said of each subject of a section that is not identical."""
    (one,) = (one for one in found.sections if one.id == section)
    return {line.subject: line.text for line in one.lines if line.grade != "identical"}


def made(folder: Path, files: Mapping[str, str] = FILES, **options: Any) -> Path:
    """Return a run of an experiment."""
    return run_folder(folder / "run", write_experiment(folder / "experiment", files), **options)


def copied(run: Path, target: Path, rows: Callable[[Row], object] = lambda _row: None) -> Path:
    """Return a copy of a run in which rows are changed; those of tries at infrastructure too."""
    shutil.copytree(run, target)
    events = [json.loads(line) for line in (target / "journal.jsonl").read_text().splitlines()]
    for one in events:
        if one["event"] == "end":
            rows(one["row"])
    (target / "journal.jsonl").write_text("".join(json.dumps(one) + "\n" for one in events))
    return target


def between(a: Path, b: Path, **margins: Margin) -> Comparison:
    """Compare one run a side."""
    return compare([str(a)], [str(b)], margins)


def test_a_run_is_identical_to_itself_and_to_its_bundle(run: Path, bundled: Path) -> None:
    for other in (run, bundled):
        found = between(run, other)
        assert (found.answer, graded(found)) == ("identical", {})
        assert [one.id for one in found.sections if one.decides] == [
            "definitions", "images", "placement", "execution", "metrics",
        ]  # fmt: skip


def test_another_run_of_the_same_is_identical_where_it_gave_the_same(run: Path, tmp_path: Path) -> None:
    """It begins at another time, and has no failed attempt."""
    assert between(run, made(tmp_path, failed=0)).answer == "identical"


def test_how_robots_are_entered_is_nobodys_matter(run: Path, tmp_path: Path) -> None:
    """An inventory that the user did not name may not say it, and that of a run is none that he named."""
    other = copied(run, tmp_path / "run")
    place = other / "sessions" / "1" / "inputs" / "inventory.yml"
    document = json.loads(place.read_text())
    document["all"]["hosts"]["r1"] |= {"ansible_ssh_private_key_file": "/k", "ansible_ssh_common_args": "-o Port=7"}
    place.write_text(json.dumps(document))
    assert between(run, other).answer == "identical"


@pytest.mark.parametrize(
    ("file", "old", "new", "grade", "told"),
    [
        ("race.edf", "seed: 7", "seed: 7 # of the first day", "equivalent", "comments"),
        ("race.edf", "A runner and a referee.", "Who is faster?", "equivalent", "descriptions"),
        ("common.cdf", "cdf: 1\nimage: runner:1", "image: runner:1\ncdf: 1", "equivalent", "order of keys"),
        ("race.edf", "timeout: 30s", "timeout: 31s", "different", "trials.timeout: '30s', and '31s'"),
        ("runner.cdf", "command: [run]", "command: [run, fast]", "different", "command: 1 entries, and 2 entries"),
        ("race.edf", "  ticks: {s", "  # {s", "different", "metrics.ticks only in A"),
        ("referee.env", "nobody", "runner", "different", "its content differs"),
        ("tracks/oval.txt", "round", "square", "different", "its content differs"),
    ],
)  # fmt: skip
def test_a_changed_file_is_named_with_its_change(
    run: Path, tmp_path: Path, file: str, old: str, new: str, grade: str, told: str
) -> None:
    assert old in FILES[file]
    found = between(run, made(tmp_path, {**FILES, file: FILES[file].replace(old, new)}))
    assert graded(found)["definitions"] == found.answer == grade
    (text,) = lines(found, "definitions").values()
    assert told in text


def test_a_file_of_one_side_is_named(run: Path, tmp_path: Path) -> None:
    other = made(tmp_path, {**FILES, "tracks/eight.txt": "8\n"})
    assert lines(between(run, other), "definitions") == {"tracks/eight.txt": f"only in {other}"}


def test_another_image_is_different_also_under_the_same_name(run: Path, tmp_path: Path) -> None:
    other = copied(run, tmp_path / "run")
    for file in other.glob("trials/*/containers.json"):
        file.write_text(
            json.dumps({**(was := json.loads(file.read_text())), "runner": {**was["runner"], "Image": "x"}})
        )
    found = between(run, other)
    assert (found.answer, graded(found)) == ("different", {"images": "different"})
    assert "and runner:1 x; their packages" in lines(found, "images")["runner"]


def test_robots_of_other_names_are_equivalent_and_another_kind_is_told(run: Path, tmp_path: Path) -> None:
    def renamed(name: str) -> None:
        place = other / "sessions" / "1" / name
        text = place.read_text().replace('"r1"', '"kuka"').replace("r1:", "kuka:").replace("robot: r1", "robot: kuka")
        place.write_text(text)

    other = copied(run, tmp_path / "run")
    for name in ("facts.json", "assignment.json", "inputs/inventory.yml", "inputs/race.edf"):
        renamed(name)
    found = between(run, other)
    assert graded(found)["placement"] == "equivalent"
    assert lines(found, "placement") == {"services": "the same services together on each robot: r1 is kuka"}
    facts = other / "sessions" / "1" / "facts.json"
    facts.write_text(facts.read_text().replace('"cpus": 4', '"cpus": 2', 1))
    found = between(run, other)
    assert lines(found, "robots") == {"r1, kuka": "cpus: 4, and 2"}
    assert graded(found)["robots"] == "different" and graded(found).get("metrics") is None


def test_a_trial_that_does_not_count_is_named(run: Path, tmp_path: Path) -> None:
    def lost(row: Row) -> None:
        if row["repetition"] == 2:
            row["status"] = "infrastructure"

    found = between(run, copied(run, tmp_path / "run", lost))
    assert (found.answer, graded(found)["execution"]) == ("different", "different")
    assert "2 of 4 trials do not count" in str(lines(found, "execution"))


def test_fewer_repetitions_are_other_trials(run: Path, tmp_path: Path) -> None:
    edf = FILES["race.edf"].replace("repetitions: 2", "repetitions: 1").replace("seed: 7", "seed: 8")
    found = between(run, made(tmp_path, {**FILES, "race.edf": edf}))
    told = lines(found, "execution")
    assert f"2 only in {run}" in told["trials"] and told["seeds"].startswith("of 2 trials")


def scattered(seed: int, by: float = 1.0) -> Callable[[Row], None]:
    """Return what gives each trial another number of steps, 5 % around its speed's."""
    random_ = random.Random(seed)

    def change(row: Row) -> None:
        row["m_steps"] *= by * random_.gauss(1, 0.05)

    return change


@pytest.mark.parametrize(
    ("by", "margin", "grade"),
    [
        (1.0, Margin(0.1, relative=True), "equivalent"),
        (1.5, Margin(0.1, relative=True), "different"),
        (1.1, Margin(0.1, relative=True), "inconclusive"),
        (1.0, Margin(30), "equivalent"),
        (1.5, Margin(30), "different"),
    ],
)
def test_a_metric_is_judged_by_its_margin(long: Path, tmp_path: Path, by: float, margin: Margin, grade: str) -> None:
    a, b = copied(long, tmp_path / "a", scattered(1)), copied(long, tmp_path / "b", scattered(2, by))
    found = between(a, b, steps=margin, success=Margin(0.2))
    assert (graded(found)["metrics"], found.answer) == (grade, grade)
    assert "(n 20)" in lines(found, "metrics")["steps"]
    assert graded(between(b, a, steps=margin, success=Margin(0.2)))["metrics"] == grade


def test_without_a_margin_nobody_knows(long: Path, tmp_path: Path) -> None:
    found = between(long, copied(long, tmp_path / "b", scattered(2)))
    assert (graded(found)["metrics"], found.answer) == ("unknown", "inconclusive")
    assert "--margin steps=" in lines(found, "metrics")["steps"]


def test_the_margin_of_the_experiment_counts_where_nobody_names_another(tmp_path: Path) -> None:
    edf = TEN["race.edf"].replace("#/steps}", "#/steps, margin: 10%}")
    stated = made(tmp_path, {**TEN, "race.edf": edf}, failed=0)
    a, b = copied(stated, tmp_path / "a", scattered(1)), copied(stated, tmp_path / "b", scattered(2))
    found = between(a, b)
    assert graded(found)["metrics"] == "equivalent"
    assert ", margin 10 % of the EDF" in lines(found, "metrics")["steps"]
    assert graded(between(a, b, steps=Margin(0.001, relative=True)))["metrics"] != "equivalent"


def test_a_part_of_the_trials_is_compared_alone(long: Path, tmp_path: Path) -> None:
    trials = [json.loads(line) for line in (long / "journal.jsonl").read_text().splitlines()]
    point = next(one["row"]["point"] for one in trials if one["event"] == "end")

    def others_fail(row: Row) -> None:
        if row["point"] != point:
            row["status"] = "infrastructure"

    b = copied(long, tmp_path / "b", others_fail)
    assert graded(between(long, b))["execution"] == "different"
    found = compare([str(long)], [str(b)], {}, [point])
    assert graded(found) == {} and found.answer == "identical"
    assert found.notes[0] == "only 10 of 20 trials are compared, as asked for"
    assert graded(compare([str(long)], [str(b)], {}, [one["row"]["trial"] for one in trials if "row" in one][:1])) == {}


def test_several_runs_a_side_are_compared_run_by_run(long: Path, tmp_path: Path) -> None:
    """A day shifts all trials of a run: twenty trials of one run tell a difference that three runs a side do not."""
    shifts = (0.85, 1.0, 1.15, 0.9, 1.05, 1.12)
    runs = [str(copied(long, tmp_path / str(at), scattered(at, by))) for at, by in enumerate(shifts)]
    margin = {"steps": Margin(0.1, relative=True), "success": Margin(0.2)}
    assert graded(compare(runs[:1], runs[5:], margin))["metrics"] == "different"
    found = compare(runs[:3], runs[3:], margin)
    assert graded(found)["metrics"] == "inconclusive"
    assert "times as many would settle it" in lines(found, "metrics")["steps"]
    assert not any("one run a side" in note for note in found.notes)
    assert "too few: 2 and 2" in lines(compare(runs[:2], runs[2:4], margin), "metrics")["steps"]


def test_the_share_of_successes_has_an_interval(long: Path, tmp_path: Path) -> None:
    def all_fail(row: Row) -> None:
        row["verdict"] = "failure"

    found = between(long, copied(long, tmp_path / "b", all_fail), success=Margin(0.1))
    assert found.answer == "different"
    assert lines(found, "metrics")["success"].startswith("A 10 of 20; B 0 of 20; B - A -0.5 [")


def test_a_broken_bundle_is_not_compared(run: Path, content: Content, tmp_path: Path) -> None:
    broken = packed({**content, "trials.csv": b"x\n"}, tmp_path / "b.zip")
    with pytest.raises(UsageError, match=r"b\.zip: trials\.csv has the sha256"):
        between(run, broken)


def test_what_is_no_run_is_an_error(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("no zip")
    for wrong in (tmp_path, tmp_path / "file"):
        assert cli(["compare", str(run), str(wrong)]) == 5
        assert "srprov bundle" in capsys.readouterr().err
    assert cli(["compare", str(run)]) == 5
    assert cli(["compare", str(run), str(run), "--margin", "nosuch=1"]) == 5
    assert "it has steps, success, ticks" in capsys.readouterr().err


@pytest.mark.parametrize(
    "text", ["steps", "steps=", "=1", "steps=0", "steps=-1", "steps=nan", "steps=inf", "steps=100%"]
)
def test_a_margin_is_a_positive_number(run: Path, text: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli(["compare", str(run), str(run), "--margin", text]) == 5
    assert "for example --margin" in capsys.readouterr().err


def test_what_is_printed(long: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    a, b = str(long), str(copied(long, tmp_path / "b", scattered(2, 1.5)))
    assert cli(["compare", a, b, "--margin", "steps=10%", "--margin", "success=20%"]) == 2
    said = capsys.readouterr()
    assert "  metrics      different" in said.out and said.out.endswith("\ndifferent: metrics\n")
    assert "are not recorded" in said.err
    assert cli(["compare", a, b, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert list(Draft202012Validator(data.schema("compare")).iter_errors(document)) == []
    assert document["answer"] == "inconclusive"
    assert cli(["compare", a, b, "--strict"]) == 2
    assert cli(["compare", a, "--with", a]) == 0
