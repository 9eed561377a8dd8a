"""`validate DIR`: all EDFs and CDFs of a folder; a folder without any is an inventory."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.cli.main import run
from srprov.definitions import with_files_below

EDF = "edf: 1\nname: demo\nservices: {a: {image: busybox}}\n"


def test_a_folders_definitions_are_checked_with_those_below(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Hidden folders are not, nor what a link leads to; one file that is wrong is named."""
    (tmp_path / "one.edf").write_text(EDF)
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "two.edf").write_text(EDF.replace("image", "imgae"))
    (tmp_path / "sub" / "c.cdf").write_text("cdf: 1\nbase: busybox\n")
    (tmp_path / ".git").mkdir()
    (tmp_path / ".git" / "three.edf").write_text("{")
    (tmp_path / "far").symlink_to("/")
    assert run(["validate", str(tmp_path)]) == 5
    said = capsys.readouterr().out
    assert "sub/two.edf:3" in said and "in 3 files" in said and "one.edf" not in said
    (tmp_path / "sub" / "two.edf").unlink()
    assert run(["validate", str(tmp_path)]) == 0
    assert capsys.readouterr().out == "2 files valid\n"


def test_records_of_runs_are_passed_over_but_where_one_is_named(tmp_path: Path) -> None:
    """What they hold was valid where it lay."""
    files = ["e.edf", "runs/x/inputs/e.edf", "results/sessions/1/inputs/e.edf"]
    for name in (*files, "runs/x/events.jsonl", "runs/x/environment.json", "results/journal.jsonl", "results/trials/1"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("")
    assert with_files_below([str(tmp_path)]) == [str(tmp_path / "e.edf")]
    assert with_files_below([str(tmp_path / "runs/x")]) == [str(tmp_path / files[1])]


def test_a_folder_without_definitions_is_an_inventory(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "hosts").write_text("robot1 unknown\n")
    assert with_files_below([str(tmp_path), "x.edf"]) == [str(tmp_path), "x.edf"]
    assert run(["validate", str(tmp_path)]) == 5
    assert "is not key=value" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("entry", "line"),
    [
        ("{image: busybox, job: true, restart: always}", 3),
        ("\n    image: busybox\n    job: true\n    restart: unless-stopped", 6),
        ("{cdf: a.cdf, restart: always}", 3),
        ("{cdf: b.cdf}", 3),
    ],
)
def test_a_job_that_is_always_started_again_is_refused_at_its_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], entry: str, line: int
) -> None:
    (tmp_path / "a.cdf").write_text("cdf: 1\nbase: busybox\njob: true\n")
    (tmp_path / "b.cdf").write_text("cdf: 1\nbase: busybox\njob: true\nrestart: always\n")
    (tmp_path / "e.edf").write_text(f"edf: 1\nname: demo\nservices: {{a: {entry}}}\n" if "{" in entry
                                    else f"edf: 1\nname: demo\nservices:\n  a:{entry}\n")  # fmt: skip
    assert run(["validate", str(tmp_path / "e.edf")]) == 5
    said = capsys.readouterr().out
    assert f"e.edf:{line + (entry[0] != '{')}" in said and "'a' is a job" in said
    assert run(["validate", str(tmp_path / "e.edf")]) == 5


def test_a_job_may_be_tried_again_when_it_fails(tmp_path: Path) -> None:
    (tmp_path / "e.edf").write_text(EDF.replace("busybox", "busybox, job: true, restart: 'on-failure:3'"))
    assert run(["validate", str(tmp_path / "e.edf")]) == 0


@pytest.mark.parametrize("name", ["a.edf.yml", "a.cdf.yaml", "a.EDF", "a.edf", "sub/a.Cdf.Yml"])
def test_a_definition_that_could_be_run_is_not(tmp_path: Path, name: str) -> None:
    """An inventory may be a program; what is called a definition is none, whoever names it, as a CI does."""
    ran, program = tmp_path / "ran", tmp_path / "project" / name
    program.parent.mkdir(parents=True)
    program.write_text(f"#!/bin/sh\ntouch {ran}\necho '{{}}'\n")
    program.chmod(0o755)
    assert run(["validate", str(tmp_path / "project")]) == 5
    assert run(["validate", "--format", "json", "--", str(program)]) == 5
    assert not ran.exists()


@pytest.mark.parametrize("name", ["run.yml", "run.json", "run", "inventory.sh", "a.edf~"])
def test_no_file_that_is_validated_is_run(tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    """Whatever it is called: a CI validates what a pattern finds in a stranger's branch, an editor what is open."""
    ran, program = tmp_path / "ran", tmp_path / name
    program.write_text(f"#!/bin/sh\ntouch {ran}\necho '{{}}'\n")
    program.chmod(0o755)
    assert run(["validate", "--", str(program)]) == 5
    assert "SRP-204" in capsys.readouterr().out and not ran.exists()


def test_a_definition_is_none_of_ansible_s_inventories(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of one, variables beside it would be read, wherever links lead, and keys that it names."""
    (tmp_path / "a.edf.yml").write_text("all: {hosts: {robot1: {ansible_ssh_private_key_file: /none}}}\n")
    (tmp_path / "host_vars").mkdir()
    (tmp_path / "host_vars" / "robot1").symlink_to("/")
    assert run(["validate", str(tmp_path)]) == 5
    assert "inventory" in capsys.readouterr().out
