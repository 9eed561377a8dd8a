"""SwarmRob's definitions: what it reads becomes an experiment, what it stumbles over is refused at its line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import yaml
from jsonschema import Draft202012Validator

from srprov import data
from srprov.cli.main import run
from srprov.definitions import load_experiment
from srprov.importing import swarmrob
from tests.bounded import bounded
from tests.unit.conversion.test_services import cases

MARK = "▶"


def _write(folder: Path, files: dict[str, str]) -> list[str]:
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text.replace(MARK, ""), encoding="utf-8")
    return list(files)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "lab"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


@pytest.mark.parametrize("case", [one for one in cases("swarmrob.yml") if "makes" in one.values[0]])
def test_what_swarmrob_reads_becomes_an_experiment(
    case: dict[str, Any], here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = _write(here, case["files"])
    code = run(["import", "swarmrob", *files, *case.get("options", ()), "--format", "json", "-o", "../out"])
    shown = capsys.readouterr()
    assert code == 0, shown.err
    document = json.loads(shown.out)
    assert list(Draft202012Validator(data.schema("import")).iter_errors(document)) == []
    written = yaml.safe_load((here / "../out/experiment.edf").read_text())
    assert written["services"] == case["makes"]
    assert written["name"] == "lab"
    assert [f"{one['line']}: {one['kept']} {one['key']}" for one in document["findings"]] == case.get("says", [])
    load_experiment(here / "../out/experiment.edf")


@pytest.mark.parametrize("case", [one for one in cases("swarmrob.yml") if "refused" in one.values[0]])
def test_what_it_stumbles_over_is_refused_at_its_line(
    case: dict[str, Any], here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = _write(here, case["files"])
    assert run(["import", "swarmrob", *files, "-o", "../out"]) == 5
    shown = capsys.readouterr().err
    assert not (here / "../out").exists()
    for part in case["refused"]:
        assert part in shown
    for name, text in case["files"].items():
        for number, line in enumerate(text.split("\n"), 1):
            if MARK in line:
                assert f"{name}:{number}:{line.index(MARK) + 1}: error[SRP-1" in shown


def test_strict_writes_nothing_when_a_key_is_dropped(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _write(here, {"a.yaml": "services:\n a:\n  image: busybox\n  tty: true\n"})
    assert run(["import", "swarmrob", "a.yaml", "--strict", "-o", "../out"]) == 5
    shown = capsys.readouterr()
    assert "a.yaml:4:3: dropped: SwarmRob passes over 'tty'" in shown.out
    assert "error[SRP-173]: nothing was written: 1 dropped, and --strict" in shown.err
    assert not (here / "../out").exists()
    assert run(["import", "swarmrob", "a.yaml", "-o", "../out"]) == 0


def test_a_folder_that_holds_files_stays_as_it_is(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _write(here, {"a.yaml": "services:\n a:\n  image: busybox\n", "../out/mine": "x"})
    assert run(["import", "swarmrob", "a.yaml", "-o", "../out"]) == 5
    assert "../out holds files already" in capsys.readouterr().err
    assert [one.name for one in (here / "../out").iterdir()] == ["mine"]


def test_thousands_of_services_and_values_are_read_in_time(tmp_path: Path) -> None:
    """Each service may be named in the values of every other one."""
    values = ", ".join(f"A{number}=x{number}_1y" for number in range(5))
    services = "".join(f"  s{number}: {{image: x, environment: [{values}]}}\n" for number in range(2000))
    (tmp_path / "swarm.yml").write_text(f"version: '3'\nservices:\n{services}")
    assert len(bounded(lambda: swarmrob.read([str(tmp_path / "swarm.yml")]).normal.document)) == 2


def test_variables_that_do_not_end_are_looked_through_in_time(tmp_path: Path) -> None:
    """Each was looked for up to the end of the text: a minute for 200 KB."""
    file = tmp_path / "a.yml"
    file.write_text(f"version: '3'\nservices: {{a: {{image: x, environment: ['A=${{B}}$C{'${' * 100_000}']}}}}\n")
    found = bounded(lambda: swarmrob.read([str(file)], {"B": "b", "C": "c"}))
    assert found.normal.document["services"]["a"]["environment"]["A"] == f"bc{'${' * 100_000}"


def test_names_of_many_services_are_looked_for_once_in_each_value(tmp_path: Path) -> None:
    names = [f"s{number:03}" for number in range(900)]
    near = " ".join(f"{name}_1x" for name in names)
    using = f"    environment: ['A={near} lab_s001_1:80 s002_1', 'B={near}']\n"
    lines = [f"  {name}:\n    image: x\n" + (using if number < 60 else "") for number, name in enumerate(names)]
    (tmp_path / "a.yml").write_text("version: '3'\nservices:\n" + "".join(lines))
    read = bounded(lambda: swarmrob.read([str(tmp_path / "a.yml")]).normal.document["services"])
    assert {name: one["hostname"] for name, one in read.items() if "hostname" in one} == {
        "s001": "lab_s001_1",
        "s002": "s002_1",
    }


def test_an_image_is_called_by_the_folder_that_is_named(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A clone has a link of that name, which leads to a folder that is called as the user's own image."""
    (here / "vendor/debian").mkdir(parents=True)
    (here / "vendor/debian/Dockerfile").write_text("FROM busybox\n")
    (here / "vendor/cam").symlink_to("debian")
    (here / "e.yml").write_text("version: '1'\nservices: {nav: {image: debian}, cam: {image: lab/cam}}\n")
    assert run(["import", "swarmrob", "e.yml", "vendor/cam/Dockerfile", "-o", "../out"]) == 0, capsys.readouterr()
    written = yaml.safe_load((here / "../out/experiment.edf").read_text())["services"]
    assert (written["nav"]["image"], "cdf" in written["cam"]) == ("debian", True)
