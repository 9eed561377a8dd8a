"""Whom the password is for that `-K` asks for once."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from srprov.cli import inputs
from srprov.cli.main import run
from srprov.secret import forget

HOSTS = "all: {hosts: {r1: {ansible_user: root}, r2: {ansible_user: pi}, r3: {ansible_become_password: own-word}}}\n"


@pytest.fixture(autouse=True)
def _typed(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(inputs, "asked_for_become", lambda: True)
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True, raising=False)
    monkeypatch.setattr(click, "prompt", lambda *_words, **_more: "typed-word")
    yield
    forget()


def test_those_who_may_be_told_it_are_named_first(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Whoever is root on one of them knows it then, so the user sees which they are. Root's login needs none."""
    (tmp_path / "i.yml").write_text(HOSTS)
    hosts = inputs.load_inventory((str(tmp_path / "i.yml"),)).hosts
    given = {name: one.become_password.reveal() for name, one in hosts.items() if one.become_password}
    assert given == {"r2": "typed-word", "r3": "own-word"}
    assert capsys.readouterr().err == "sudo's password is told any of these that asks: r2\n"


def test_where_nobody_needs_one_none_is_asked_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "i.yml").write_text("all: {hosts: {r1: {ansible_user: root}}}\n")
    assert inputs.load_inventory((str(tmp_path / "i.yml"),)).hosts["r1"].become_password is None
    assert capsys.readouterr().err == ""


def test_robots_of_an_inventory_that_the_user_did_not_name_are_told_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A project calls a stranger's host as a robot of his, and the name is all that is shown."""
    hosts = "all: {hosts: {r2: {ansible_user: pi, ansible_host: 127.0.0.1, ansible_port: 1}}}\n"
    (tmp_path / "i.yml").write_text(hosts)
    (tmp_path / "srprov.toml").write_text("inventory = 'i.yml'\ntimeout = 1\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setattr(click, "prompt", lambda *_words, **_more: pytest.fail("it was asked for"))
    assert run(["facts", "-K"]) == 5
    assert "an inventory that you did not name" in capsys.readouterr().err
    (tmp_path / "i.yml").write_text(hosts.replace("pi", "root"))
    assert run(["facts", "-K"]) == 4, "where root logs in nobody is told one"


@pytest.mark.parametrize("place", ["variable", "own", "verb", "project", "project's pyproject", "both"])
def test_robots_that_the_user_has_by_name_are_told_it_and_a_projects_are_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], place: str
) -> None:
    """`robot1,robot2,` are the same robots in each folder, and the names in a project's file a stranger's choice."""
    lab, own, given = tmp_path / "lab", tmp_path / "conf/srprov/srprov.toml", "inventory = ['192.0.2.1,']\n"
    for folder in (lab, own.parent):
        folder.mkdir(parents=True)
    own.write_text({"own": given, "verb": f"[facts]\n{given}", "both": "inventory = 'a.yml'\n"}.get(place, ""))
    (lab / "srprov.toml").write_text("timeout = 0.1\n" + given * (place in ("project", "both")))
    (lab / "pyproject.toml").write_text(f"[tool.srprov]\n{given}" if place.endswith("pyproject") else "")
    monkeypatch.chdir(lab)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "conf"))
    if place == "variable":
        monkeypatch.setenv("SRPROV_FACTS_INVENTORY", "192.0.2.1,")
    of_project = place not in ("variable", "own", "verb")
    if of_project:
        monkeypatch.setattr(click, "prompt", lambda *_words, **_more: pytest.fail("it was asked for"))
    assert run(["facts", "-K"]) == (5 if of_project else 4)
    said = capsys.readouterr().err
    assert ("an inventory that you did not name" in said) is of_project
    assert ("sudo's password is told any of these that asks: 192.0.2.1\n" in said) is not of_project
    assert "of your own configuration" not in said


def test_robots_of_the_record_of_another_machine_are_told_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its user names it for robots of his own, and it may say where somebody else's is."""
    recorded = tmp_path / "run" / "inputs" / "inventory.yml"
    recorded.parent.mkdir(parents=True)
    recorded.write_text("all: {hosts: {r2: {ansible_user: pi, ansible_host: 127.0.0.1, ansible_port: 1}}}\n")
    monkeypatch.setattr(click, "prompt", lambda *_words, **_more: pytest.fail("it was asked for"))
    assert run(["facts", "-K", "-i", str(recorded)]) == 5
    said = capsys.readouterr().err
    assert "sudo's password to robots of a record that may be a stranger's" in said
    assert "is not known as of a run here whose inventory you named: it says only where robots are" in said
