"""Errors as they are printed: whose they are, in how many files, and what to do."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.cli.main import run, show_error
from srprov.codes import Code
from srprov.errors import ConnectError, DefinitionError, Diagnostic, Location


def test_an_error_of_a_robot_names_it_once(capsys: pytest.CaptureFixture[str]) -> None:
    show_error(ConnectError("r7", "10.0.0.7 port 22: no route to the host"))
    show_error(ConnectError("r7", "r7 is away"))
    assert capsys.readouterr().err.splitlines() == [
        "error[SRP-302]: r7: 10.0.0.7 port 22: no route to the host",
        "error[SRP-302]: r7 is away",
    ]


def test_problems_are_counted_with_their_files() -> None:
    one, two = (Diagnostic(Location(name, 1, 1), "wrong", code=Code.YAML) for name in ("a.yml", "b.yml"))
    assert DefinitionError([one]).message == "1 problem in 1 file"
    assert DefinitionError([one, one, two]).message == "3 problems in 2 files"


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("edf: 1\nname: a\nservices: {a: {image: x, environment: {A: ${HOME}}}}\n", "quote a value with a brace"),
        ("name: a\nservices: {a: {image: x}}\n", "for example `edf: 1`"),
    ],
)
def test_a_file_that_lacks_little_is_helped(
    text: str, hint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "e.edf").write_text(text)
    assert run(["validate", str(tmp_path / "e.edf")]) == 5
    assert hint in "".join(capsys.readouterr())


def test_a_misspelt_service_is_told_before_the_missing_terminal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "e.edf").write_text("edf: 1\nname: a\nservices: {talker: {image: x, replicas: 2}}\n")
    monkeypatch.setattr("sys.stdin", open("/dev/null"))  # noqa: SIM115 - it is for the whole test
    assert run(["restart", str(tmp_path / "e.edf"), "-i", "r,", "talkr"]) == 5
    assert "did you mean 'talker'?" in capsys.readouterr().err
    for there in ("talker-2", "nothing-like-it"):
        assert run(["restart", str(tmp_path / "e.edf"), "-i", "r,", there]) == 9
        assert "there is no terminal to ask on" in capsys.readouterr().err


def test_the_labs_verbs_are_listed_with_their_whole_lines(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["lab", "--help"]) == 0
    shown = capsys.readouterr().out.partition("Commands:")[2]
    assert shown and "..." not in shown and "…" not in shown
    assert shown.index("  clock ") < shown.index("  up ")
