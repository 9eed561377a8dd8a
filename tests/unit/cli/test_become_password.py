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
