"""A stranger's playbook is refused before any robot is asked; only the user gives permission."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.cli.main import run

EDF = """\
edf: 1
name: demo
services:
  a: {image: busybox}
playbooks: {before: [setup.yml]}
"""
SETUP = "- command: x\n  argv: [touch, /x]\n  unless: [test, -e, /x]\n"


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder with an experiment, and an inventory whose only robot refuses connections."""
    (tmp_path / "e.edf").write_text(EDF)
    (tmp_path / "setup.yml").write_text(SETUP)
    (tmp_path / "inv.yml").write_text("all: {hosts: {r1: {ansible_host: 127.0.0.1, ansible_port: 1}}}\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    return tmp_path


def own(here: Path, name: str, text: str) -> None:
    """Write a file of the user's own configuration."""
    file = here / "config" / "srprov" / name
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text)


@pytest.mark.parametrize("verb", [["plan"], ["apply", "--yes"], ["plan", "--allow", "secret", "--allow", "privileged"]])
def test_without_permission_nothing_is_begun(here: Path, capsys: pytest.CaptureFixture[str], verb: list[str]) -> None:
    """Exit 9 names playbook, line, command, check and flag; the robot, which is out of reach, was not even tried."""
    assert run([*verb, "e.edf", "-i", "inv.yml"]) == 9
    said = capsys.readouterr().err
    assert "setup.yml: playbook (states anything on the robots, as root)" in said
    assert "setup.yml:1: playbook (runs: touch /x; its check, which plan runs too: test -e /x)" in said
    assert "--allow playbook" in said
    assert "unreachable" not in said


@pytest.mark.parametrize("more", [["--allow", "playbook"], ["--allow", "all"], []])
def test_the_user_gives_permission(here: Path, more: list[str]) -> None:
    """By a flag, or in his own configuration; then the robot is tried."""
    if not more:
        own(here, "srprov.toml", 'allow = ["playbook"]\n')
    assert run(["plan", "e.edf", "-i", "inv.yml", *more]) != 9


def test_a_project_gives_none(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its configuration may come from the same stranger."""
    (here / "srprov.toml").write_text('allow = ["playbook"]\n')
    assert run(["plan", "e.edf", "-i", "inv.yml"]) == 5
    assert "srprov.toml:1: a project's file cannot set 'allow'" in capsys.readouterr().err


def test_validate_needs_no_permission(here: Path) -> None:
    """It only reads."""
    assert run(["validate", "e.edf"]) == 0


def test_what_is_wrong_in_ones_own_folder_is_told_at_its_place(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """All of it, with exit 5; what is not named *.yml is not looked at."""
    own(here, "playbooks/05-a.yml", "- fil: x\n")
    own(here, "playbooks/06-b.yml", "- command: x\n  argv: [a]\n")
    own(here, "playbooks/notes.txt", "- fil: x\n")
    assert run(["plan", "e.edf", "-i", "inv.yml", "--allow", "playbook"]) == 5
    said = capsys.readouterr().err
    assert f"{here}/config/srprov/playbooks/05-a.yml:1:3: error[SRP-141]: there is no module 'fil'" in said
    assert f"{here}/config/srprov/playbooks/06-b.yml:1:3: error[SRP-106]: needs 'unless' or 'creates'" in said
    assert "2 problems" in said
