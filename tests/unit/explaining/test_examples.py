"""The examples of the pages: the bad one gives its code, the good one gives none."""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Mapping
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from srprov import data
from srprov.cli.main import run
from srprov.codes import Code
from srprov.explaining import Page, pages
from tools.errors_page import TARGET, text

ROOT = Path(__file__).parents[3]
_SHOWN = re.compile(r"\[(SRP-[0-9]{3})\]")

RUN = [page for page in pages().values() if page.run]
NAMED = [page for page in pages().values() if not page.run]


def codes_of(
    folder: Path, words: str, files: Mapping[str, str], program: str, capsys: pytest.CaptureFixture[str]
) -> set[str]:
    """Write an example into a folder, run it, and return every code that is told."""
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(content, encoding="utf-8")
    if program:
        (folder / program).chmod(0o755)
    capsys.readouterr()
    code = run(words.split())
    shown = capsys.readouterr()
    found = set(_SHOWN.findall(shown.out + shown.err))
    assert (code != 0) is bool(found), shown
    return found


@pytest.mark.parametrize("page", RUN, ids=lambda page: page.code.value)
def test_the_bad_example_gives_its_code_and_the_good_one_none(
    page: Page, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    examples = [("bad", page.run, page.bad, {page.code.value})]
    examples += [("good", page.good_run, page.good, set[str]())] if page.good.files else []
    for word, words, example, expected in examples:
        folder = tmp_path / word / "demo"
        folder.mkdir(parents=True)
        monkeypatch.chdir(folder)
        assert codes_of(folder, words, example.files, page.executable, capsys) == expected, word


@pytest.mark.parametrize("page", NAMED, ids=lambda page: page.code.value)
def test_what_needs_more_than_files_names_the_test_that_shows_it(page: Page) -> None:
    file, _, function = page.test.partition("::")
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    assert function in {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}, page.test
    assert page.bad.text and page.good.text


def test_every_code_has_a_page() -> None:
    """With a title that fits into a line, whole sentences, and two examples."""
    assert list(pages()) == list(Code)
    for page in pages().values():
        assert len(page.title) <= 80 and not page.title.endswith("."), page.code
        assert page.means.endswith(".") and page.do.endswith("."), page.code
        assert (page.bad, page.run) != (page.good, page.good_run), page.code
        assert bool(page.run) is not bool(page.test), page.code


def test_the_manual_has_the_pages_as_they_are() -> None:
    """`make errors` writes it anew."""
    assert TARGET.read_text(encoding="utf-8") == text()


@pytest.mark.parametrize("word", ["SRP-105", "srp-105", "105"])
def test_a_code_is_explained_however_it_is_written(word: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["explain", word]) == 0
    said = capsys.readouterr().out
    assert said.startswith("SRP-105: unknown key\n") and "enviroment: {RATE: 2}" in said and "What to do:" in said


def test_all_codes_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["explain"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == [code.value for code in Code]
    assert run(["explain", "SRP-999"]) == 5
    assert "error[SRP-212]: there is no code 'SRP-999'" in capsys.readouterr().err


@pytest.mark.parametrize("words", [["explain", "--json"], ["explain", "302", "--json"], ["explain", "105", "--json"]])
def test_the_document_is_what_its_schema_says(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(words) == 0
    document = json.loads(capsys.readouterr().out)
    assert list(Draft202012Validator(data.schema("explain")).iter_errors(document)) == []
    assert len(document["codes"]) == (1 if len(words) == 3 else len(Code))


def test_rules_of_sarif_are_the_codes_with_their_pages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One rule for each code that occurs, however often."""
    monkeypatch.chdir(tmp_path)
    Path("e.edf").write_text("edf: 1\nname: a\nservices: {a: {image: x, cots: 1, cst: 2, cost: 101}}\n")
    assert run(["validate", "e.edf", "--format", "sarif"]) == 5
    (log,) = json.loads(capsys.readouterr().out)["runs"]
    assert [result["ruleId"] for result in log["results"]] == ["SRP-105", "SRP-105", "SRP-108"]
    rules = log["tool"]["driver"]["rules"]
    assert [(rule["id"], rule["name"]) for rule in rules] == [("SRP-105", "UnknownKey"), ("SRP-108", "WrongValue")]
    assert rules[0]["shortDescription"]["text"] == "Unknown key."
    assert "**What to do.** Correct the spelling" in rules[0]["help"]["markdown"]
    assert "What to do:" in rules[0]["help"]["text"]


@pytest.mark.parametrize("key", ["a\\nerror[SRP-001]: x", "x]: error[SRP-001]: y", "\\u2028error[SRP-001]: x"])
def test_words_of_a_file_choose_no_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], key: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("e.edf").write_text(f'edf: 1\nname: a\n"{key}": 1\nservices: {{a: {{image: x}}}}\n')
    assert run(["validate", "e.edf"]) == 5
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("e.edf:3:1: error[SRP-105]: unknown key")
    assert not [line for line in lines if line.startswith("error[")]
    assert run(["validate", "e.edf", "--format", "json"]) == 5
    assert [one["code"] for one in json.loads(capsys.readouterr().out)["problems"]] == ["SRP-105"]
