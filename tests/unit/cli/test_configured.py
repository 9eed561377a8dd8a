"""`config`: each setting, its value, and who says so; and the variables that set options."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from srprov import data
from srprov.cli.main import run


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    for name in ("XDG_CONFIG_HOME", "SRPROV_RUNS"):
        monkeypatch.delenv(name, raising=False)
    (tmp_path / "home" / ".config" / "srprov").mkdir(parents=True)
    return tmp_path


def settings(capsys: pytest.CaptureFixture[str], *words: str) -> dict[tuple[str, str], dict[str, Any]]:
    """Return what `config --json` says of each verb's settings."""
    assert run(["config", "--json", *words]) == 0
    document = json.loads(capsys.readouterr().out)
    Draft202012Validator(data.schema("config")).validate(document)
    return {(row["verb"], row["setting"]): row for row in document["settings"]}


def test_each_setting_says_where_it_comes_from(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """From weak to strong: default, user, project, environment; a verb's own table before what holds for all."""
    own = folder / "home" / ".config" / "srprov" / "srprov.toml"
    own.write_text("# mine\nforks = 3\nyes = true\n\n[export]\ntimeout = 4.0\n")
    (folder / "pyproject.toml").write_text("[project]\nname = 'x'\n[tool.srprov]\nforks = 5\nsettle = 1.0\n")
    (folder / "srprov.toml").write_text("[apply]\nforks = 7\nsettle = 9.0\n")
    monkeypatch.setenv("SRPROV_APPLY_SETTLE", "8")
    monkeypatch.setenv("SRPROV_PLAN_INVENTORY", "lab.yml")

    found = settings(capsys)

    def told(verb: str, name: str) -> tuple[Any, str, str | None, int | None, str | None]:
        row = found[verb, name]
        return row["value"], row["source"], row["file"], row["line"], row["variable"]

    assert told("apply", "forks") == (7, "project", str(folder / "srprov.toml"), 2, None)
    assert told("plan", "forks") == (5, "project", str(folder / "pyproject.toml"), 4, None)
    assert told("apply", "yes") == (True, "user", str(own), 3, None)
    assert told("apply", "settle") == ("8", "environment", None, None, "SRPROV_APPLY_SETTLE")
    assert told("plan", "inventory") == (["lab.yml"], "environment", None, None, "SRPROV_PLAN_INVENTORY")
    assert told("export compose", "timeout") == (4.0, "user", str(own), 6, None)
    assert told("plan", "timeout") == (10.0, "default", None, None, None)
    assert told("plan", "runs") == (None, "default", None, None, None)
    assert {verb for verb, _ in settings(capsys, "plan")} == {"plan"}
    (folder / "srprov.toml").write_text("inventory = 'robots.yml'\n")
    found = settings(capsys)
    assert told("apply", "inventory") == (["robots.yml"], "project", str(folder / "srprov.toml"), 1, None)
    own.write_text("inventory = '/lab/mine.yml'\n")
    found = settings(capsys)
    assert told("apply", "inventory") == (["/lab/mine.yml"], "user", str(own), 1, None), "a project's gives way"


def test_what_config_says_is_what_the_verb_takes(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """An option's variable has the option's name, also where the code calls it otherwise."""
    (folder / "e.edf").write_text("edf: 1\nname: x\nservices: {a: {image: busybox}}\n")
    (folder / "inv").write_text("")
    for name in ("SRPROV_PLAN_INVENTORY", "SRPROV_PLAN_INVENTORIES"):
        monkeypatch.setenv(name, "inv")
        assert settings(capsys, "plan")["plan", "inventory"]["variable"] == name
        assert run(["plan", "e.edf"]) == 5
        assert "no robots in inv" in capsys.readouterr().err
        monkeypatch.delenv(name)


def test_as_text_verbs_with_one_value_share_a_line(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "srprov.toml").write_text("forks = 7\n[apply]\nforks = 9\n")
    assert run(["config"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert f"{folder}/srprov.toml" in lines
    (nine,) = [line for line in lines if line.startswith("forks") and " 9 " in line]
    assert nine.split() == ["forks", "9", f"{folder}/srprov.toml:3", "apply"]
    assert any(line.startswith("timeout") and line.endswith("every verb that has it") for line in lines)
    assert run(["config", "apply", "--changed"]) == 0
    assert capsys.readouterr().out.splitlines()[-1].split() == nine.split()


def test_the_value_of_an_assignment_is_not_shown(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("SRPROV_EXEC_ENV", "TOKEN=hunter2")
    assert settings(capsys, "exec")["exec", "env"]["value"] == ["TOKEN=…"]


def test_nothing_is_opened_or_made(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a variable names is shown, not written to."""
    monkeypatch.setenv("SRPROV_APPLY_EVENTS", str(folder / "events.jsonl"))
    assert run(["config"]) == 0
    assert not (folder / "events.jsonl").exists()


def test_the_lab_that_is_meant_is_shown(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("SRPROV_LAB", "anna")
    assert run(["config", "--changed"]) == 0
    (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("SRPROV_LAB")]
    assert line.split()[1] == "anna"


def test_a_verb_without_settings_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["config", "aply"]) == 5
    assert "did you mean 'apply'?" in capsys.readouterr().err
