"""`srprov report` of what `apply` and `plan -o` really write, on robots that are made up."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from srprov.cli.main import run
from tests.fakes import World
from tests.unit.report.pages import Page, wrong_numbers

EDF = """edf: 1
name: demo
services:
  talker: {image: 'alpine:3', robot: r1, environment: {RATE: '2'}}
  listener: {image: 'alpine:3', requires: {memory: 1MiB}}
"""


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.delenv("SRPROV_RUNS", raising=False)
    (tmp_path / "e.edf").write_text(EDF)
    return tmp_path / "state" / "srprov" / "runs"


def shown(source: str) -> Page:
    assert run(["report", source, "-o", "page.html"]) == 0
    page = Page(Path("page.html").read_text())
    assert page.faults == []
    return page


def test_a_run_has_a_page_by_its_name_with_costs_reasons_and_a_time_line(world: World, home: Path) -> None:
    assert run(["apply", "e.edf", "-i", "inv.yml", "--yes", "--settle", "0"]) == 0
    (folder,) = home.iterdir()
    page = shown(folder.name)
    result = json.loads((folder / "result.json").read_text())
    assert wrong_numbers(page, result) == []
    assert dict((at, exact) for at, exact, _ in page.numbers)["/changed"] == str(result["changed"])
    for words in ("✓ Done", "Cost of each service on each robot", "pinned to r1", "Critical path", "srprov apply"):
        assert words in page.text, words
    assert {"placement", "changes", "time", "images", "robots", "origin", "limits"} <= set(page.ids)
    assert page.text.count("e.edf") >= 2, "where it comes from, and among the files"


def test_a_plan_has_a_page_before_anything_is_changed(world: World, home: Path) -> None:
    assert run(["plan", "e.edf", "-i", "inv.yml", "-o", "plan.json"]) == 0
    page = shown("plan.json")
    plan = json.loads(Path("plan.json").read_text())
    said = {at: exact for at, exact, _ in page.numbers}
    assert said["/counts/create"] == str(plan["counts"]["create"])
    assert "Run:" not in page.text and "Plan: demo" in page.text
    assert plan["proof"] == "" or plan["proof"] not in Path("page.html").read_text()
