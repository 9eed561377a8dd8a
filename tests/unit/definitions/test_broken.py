"""Every broken file in `tests/cases/broken/` through the real command line: exit 5, the right places and words."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from srprov.cli.main import run
from srprov.definitions import load_inventory
from srprov.errors import DefinitionError

CASES = Path(__file__).parents[2] / "cases" / "broken"
MARK = "▶"
PROBLEM = re.compile(r"(?P<place>[^:\s][^:]*:\d+:\d+): error\[(?P<code>SRP-[0-9]{3})\]: (?P<message>.*)")


def _cases() -> list[Any]:
    return [
        pytest.param(case, id=f"{file.stem}: {case['case']}")
        for file in sorted(CASES.glob("*.yml"))
        for case in yaml.safe_load(file.read_text(encoding="utf-8"))
    ]


def _places(name: str, marked: str) -> list[str]:
    """Return `file:line:column` of each mark, counted as if no mark were there."""
    places = []
    for number, line in enumerate(marked.split("\n"), 1):
        for index, match in enumerate(re.finditer(MARK, line)):
            places.append(f"{name}:{number}:{match.start() - index + 1}")
    return places


def _write(folder: Path, case: dict[str, Any]) -> None:
    for name, text in case["files"].items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text.replace(MARK, ""), encoding="utf-8")
    for name, target in case.get("links", {}).items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        os.symlink(target, folder / name)
    for name, text in case.get("programs", {}).items():
        (folder / name).write_text(text)
        (folder / name).chmod(0o755)


@pytest.mark.parametrize("case", _cases())
def test_problem_is_told_at_its_place(
    case: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    _write(tmp_path, case)
    monkeypatch.chdir(tmp_path)
    named = [name for name, text in case["files"].items() if MARK in text or name.endswith(".edf")]
    command = case.get("command") or named[-1:]

    code = run(["validate", *command])

    shown = capsys.readouterr()
    found = [match for match in map(PROBLEM.fullmatch, shown.out.splitlines()) if match]
    expected = [place for name, text in sorted(case["files"].items()) for place in _places(name, text)]
    assert code == 5, shown
    assert [match["place"] for match in found] == (case.get("at") or expected), shown.out
    for match, words in zip(found, case["says"], strict=True):
        assert words in match["message"]
    for hint in case.get("hints", []):
        assert f"hint: {hint}" in shown.out
    assert "Traceback" not in shown.out + shown.err


@pytest.mark.parametrize(
    ("text", "words"),
    [("echo no such lab >&2\nexit 3\n", "'--list' ended with 3: no such lab"), ("echo hello\n", "printed no JSON")],
)
def test_a_program_that_gives_no_inventory_is_told(tmp_path: Path, text: str, words: str) -> None:
    """By verbs that run it."""
    _write(tmp_path, {"files": {}, "programs": {"inv.sh": f"#!/bin/sh\n{text}"}})
    with pytest.raises(DefinitionError) as refused:
        load_inventory([tmp_path / "inv.sh"])
    (problem,) = refused.value.problems
    assert str(problem.location) == f"{tmp_path}/inv.sh:1:1" and words in problem.message


def test_there_are_many_kinds_of_broken_files() -> None:
    assert len(_cases()) >= 30


def test_caret_stands_below_the_column(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("e.edf").write_text("edf: 1\nname: a\nservices:\n  a: {image: x, cost: 101}\n")

    run(["validate", "e.edf"])

    lines = capsys.readouterr().out.splitlines()
    assert lines == [
        "e.edf:4:23: error[SRP-108]: 101 is more than 100  [services.a.cost]",
        "    |   a: {image: x, cost: 101}",
        "    |                       ^",
        "1 problem in 1 file",
    ]
