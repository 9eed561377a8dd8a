"""`srprov lab`: what it says and takes, without a lab."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from srprov.cli.main import run
from srprov.lab import lab, overview


@pytest.mark.parametrize("words", [["hostname", "-f"], ["--", "hostname", "-f"]])
def test_a_command_may_stand_behind_dashes_as_with_ssh(monkeypatch: pytest.MonkeyPatch, words: list[str]) -> None:
    """Only the first are srprov's: all behind them belong to the command."""
    done: list[Any] = []

    def shell(_name: str, robot: str, command: Sequence[str]) -> list[str]:
        return [robot, *command]

    monkeypatch.setattr(lab, "shell", shell)
    monkeypatch.setattr(os, "execv", lambda program, every: done.append((program, every)))
    assert run(["lab", "shell", "robot1", *words, "--"]) == 0
    assert done == [("robot1", ["robot1", "hostname", "-f", "--"])]


@pytest.mark.parametrize(("name", "file"), [("", "lab.yml"), ("r1", "lab-r1.yml")])
def test_up_says_how_other_verbs_reach_its_robots(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str, file: str
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(lab, "up", lambda *_all: [])
    monkeypatch.setattr(overview, "robots", lambda _name: [])
    assert run(["lab", "--name", name, "up"]) == 0
    assert f"use them with -i inventory/{file}" in capsys.readouterr().err.splitlines()


def test_no_line_of_a_file_elsewhere_is_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A project that was cloned may bring a link as its lab-spec.yml, or one to the folder that holds it."""
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "lab-spec.yml").write_text("token: hunter2\n")
    (tmp_path / "clone").mkdir()
    (tmp_path / "clone" / "lab-spec.yml").symlink_to(tmp_path / "own" / "lab-spec.yml")
    (tmp_path / "clone" / "lab").symlink_to(tmp_path / "own")
    monkeypatch.chdir(tmp_path / "clone")
    for path in ("lab-spec.yml", "lab/lab-spec.yml", "../clone/lab-spec.yml"):
        assert run(["lab", "up", "--spec", path]) == 5
        said = capsys.readouterr()
        assert "hunter2" not in said.out + said.err and "is a link that leads out of its folder" in said.err
    assert run(["lab", "up", "--spec", str(tmp_path / "own" / "lab-spec.yml")]) == 5
    assert "unknown key 'token'" in capsys.readouterr().err
