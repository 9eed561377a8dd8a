"""What is told of a command line that is wrong: the user's word first, a file that is missing before all."""

from __future__ import annotations

from pathlib import Path

import click
import pytest

from srprov.cli.main import cli, run
from srprov.cli.misuse import _ELSEWHERE, _OPTIONS, _OTHERWISE


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    Path("experiment.edf").write_text("edf: 1\nname: a\nservices: {a: {image: x}}\n")
    return tmp_path


def told(capsys: pytest.CaptureFixture[str], *words: str) -> list[str]:
    """Run a command line that is wrong, and return the lines that it prints."""
    assert run(list(words)) == 5
    shown = capsys.readouterr()
    assert shown.out == ""
    return shown.err.splitlines()


@pytest.mark.parametrize(
    ("words", "says", "hint"),
    [
        ("pln experiment.edf", "error[SRP-210]: srprov has no verb 'pln'", "did you mean 'plan'?"),
        ("import compos x", "error[SRP-210]: srprov import has no verb 'compos'", "did you mean 'compose'?"),
        (
            "experiment.edf",
            "error[SRP-210]: srprov has no verb 'experiment.edf'",
            "name a verb before the file: srprov validate experiment.edf",
        ),
        ("xyz", "error[SRP-210]: srprov has no verb 'xyz'", "`srprov --help` lists the verbs"),
        ("plan --inventry x", "error[SRP-211]: srprov plan has no option '--inventry'", "did you mean '--inventory'?"),
        (
            "plan --qqqqqq x",
            "error[SRP-211]: srprov plan has no option '--qqqqqq'",
            "`srprov plan --help` lists its options",
        ),
        ("validate experiment.edf --format jsn", "error[SRP-212]: --format cannot be 'jsn'", "did you mean 'json'?"),
        ("validate experiment.edf --format 7", "error[SRP-212]: --format cannot be '7'", "known: text, json, sarif"),
        ("plan experiment.edf --forks x -i r,", "error[SRP-212]: --forks: ", ""),
        (
            "destroy experiment.edf -i r, --all",
            "error[SRP-211]: srprov destroy has no option '--all'",
            "did you mean '--all-instances'?",
        ),
        (
            "plan -f experiment.edf -i r,",
            "error[SRP-212]: --forks: 'experiment.edf' is not a valid integer range",
            "the file stands without an option: srprov VERB FILE -i INVENTORY",
        ),
        ("plan experiment.edf -i", "error[SRP-212]: -i needs a value", "`--help` behind the verb says which"),
        ("validate", "error[SRP-214]: srprov validate needs FILES", "`srprov validate --help` says what it is"),
        ("plan experiment.edf", "error[SRP-214]: srprov plan needs --inventory", "-i FILE: Inventory; may be"),
        ("history", "error[SRP-210]: srprov has no verb 'history'", "`srprov runs` does that"),
        ("lab history", "error[SRP-210]: srprov lab has no verb 'history'", "`srprov lab --help` lists the verbs"),
        ("plan experiment.edf b -i r,", "error[SRP-213]: srprov plan takes no further 'b'", "--target SERVICE is for"),
        ("facts b -i r,", "error[SRP-213]: srprov facts takes no further 'b'", "`srprov facts --help` says"),
        (
            "apply experiment.edf --auto-approve",
            "error[SRP-211]: srprov apply has no option '--auto-approve'",
            "`--yes` does",
        ),
        (
            "apply experiment.edf --only a",
            "error[SRP-211]: srprov apply has no option '--only'",
            "`--target` does that",
        ),
        (
            "apply experiment.edf --dry-run",
            "error[SRP-211]: srprov apply has no option '--dry-run'",
            "`srprov plan` shows",
        ),
        ("lab up --detach", "error[SRP-211]: srprov lab up has no option '--detach'", "`srprov lab up --help`"),
        ("exec experiment.edf -it a sh", "error[SRP-220]: -it is the inventory 't'", "a terminal is -t alone"),
        ("ssh -it r1", "error[SRP-220]: -it is the inventory 't'", "a terminal is -t alone"),
    ],
)
def test_the_word_that_is_wrong_comes_first_and_usage_last(
    here: Path, capsys: pytest.CaptureFixture[str], words: str, says: str, hint: str
) -> None:
    lines = told(capsys, *words.split())
    assert lines[0].startswith(says), lines
    assert hint in lines[1]
    assert not [line for line in lines[:1] if "Usage" in line]


@pytest.mark.parametrize("words", ["verify nope.zip", "apply experiment.edf --signers nope -i r,"])
def test_usage_is_not_told_for_a_file_that_is_missing(
    here: Path, capsys: pytest.CaptureFixture[str], words: str
) -> None:
    lines = told(capsys, *words.split())
    assert lines[0].startswith("error[SRP-220]: there is no file 'nope")
    assert "Usage" not in "".join(lines)


def test_a_missing_file_is_told_before_what_is_wrong_with_options(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With the file beside it that was meant; what goes into a file is not looked for."""
    lines = told(capsys, "plan", "experimnt.edf", "--inventry", "x", "-o", "new.yml")
    assert lines[:2] == ["error[SRP-220]: there is no file 'experimnt.edf'", "  did you mean 'experiment.edf'?"]
    assert lines[2].startswith("error[SRP-211]: ")
    assert len([line for line in lines if "SRP-220" in line]) == 1


def test_words_of_the_command_line_cannot_write_lines_of_their_own(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for words in (
        ["a\nerror[SRP-001]: b"],
        ["plan", "--x\nerror[SRP-001]: b"],
        ["plan", "a\nerror[SRP-001]: b.edf", "--y"],
    ):
        assert not [line for line in told(capsys, *words) if line.startswith("error[SRP-001]")]


def test_the_file_that_was_meant_is_named_where_an_edf_is_read(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("experiment.yml").write_text("")
    lines = told(capsys, "plan", "experimnt.edf", "-i", "r1,")
    assert lines[:2] == [
        "experimnt.edf:1:1: error[SRP-101]: cannot be read: there is no such file",
        "    hint: did you mean 'experiment.edf'?",
    ]


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        ("schema edff", "did you mean 'edf'?"),
        ("plan experiment.edf -i r1, --allow host-netwrk", "did you mean 'host-network'?"),
    ],
)
def test_values_that_are_one_of_many_are_told_with_the_nearest(
    here: Path, capsys: pytest.CaptureFixture[str], words: str, hint: str
) -> None:
    lines = told(capsys, *words.split())
    assert lines[0].startswith("error[SRP-212]: ") and hint in lines[1]


def test_verbs_of_other_tools_lead_to_one_that_is_there() -> None:
    verbs = set(cli.list_commands(click.Context(cli)))
    assert not set(_ELSEWHERE) & verbs
    assert {verb.split()[0] for verb in _ELSEWHERE.values()} <= verbs


def test_options_of_other_tools_lead_to_one_that_is_there() -> None:
    context = click.Context(cli)
    apply = {one for param in cli.get_command(context, "apply").params for one in param.opts}  # type: ignore[union-attr]
    plan = {one for param in cli.get_command(context, "plan").params for one in param.opts}  # type: ignore[union-attr]
    assert set(_OPTIONS.values()) <= apply | plan
    assert not _OTHERWISE.keys() & (apply | plan)
