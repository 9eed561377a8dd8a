"""The command line as a whole: `-h` says what a shell takes, and whatever goes wrong is told."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from srprov.cli.main import cli, run


def commands(command: click.Command, name: str) -> Iterator[tuple[str, click.Command]]:
    """Return a command and all below it."""
    yield name, command
    if isinstance(command, click.Group):
        for verb in command.list_commands(click.Context(command)):
            below = command.get_command(click.Context(command), verb)
            assert below is not None
            yield from commands(below, f"{name} {verb}")


def test_a_broken_pipe_of_a_connection_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """click takes every broken pipe for that of standard output, and would end without a word."""

    def broken(_kind: str) -> None:
        raise BrokenPipeError(32, "Broken pipe")

    monkeypatch.setattr("srprov.data.schema", broken)
    monkeypatch.setattr("sys.stdout", sys.stdout)
    monkeypatch.setattr("sys.stderr", sys.stderr)
    assert run(["schema", "edf"]) == 1
    assert "BrokenPipeError" in capsys.readouterr().err


EVERY = dict(commands(cli, "srprov"))


ROOT = Path(__file__).parents[3]


def test_a_folder_that_is_gone_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Another shell removed it, or a build made it anew."""
    (tmp_path / "gone").mkdir()
    monkeypatch.setattr("sys.stderr", sys.stderr)
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    assert run(["runs", "list"]) == 5
    assert "the folder in which you are cannot be named" in capsys.readouterr().err


def test_there_are_all_verbs() -> None:
    assert len(EVERY) > 20 and {"srprov apply", "srprov lab up"} <= EVERY.keys()


def test_the_readme_has_a_row_for_every_verb_and_for_nothing_else() -> None:
    table = (ROOT / "README.md").read_text(encoding="utf-8").split("| verb | does |")[1].split("\n\n")[0]
    rows = [re.split(r"(?<!\\)\|", line)[1] for line in table.splitlines()[2:]]
    stated = [verb for row in rows for words in re.findall("`([^`]+)`", row) for verb in words.split()[0].split("\\|")]
    assert isinstance(cli, click.Group)
    assert {verb for verb in stated if verb.islower()} == set(cli.list_commands(click.Context(cli)))


def test_the_manual_says_of_every_verb_that_asks_robots_whether_it_locks_them() -> None:
    """`diff` reads from an inventory what facts do not have, and asks nobody."""
    section = (ROOT / "docs" / "reliability.md").read_text(encoding="utf-8").split("\n## ")[1]
    said = {words.split()[0] for words in re.findall("`([a-z ]+)`", section)}
    asking = {name.split()[1] for name, verb in EVERY.items() if any("--inventory" in one.opts for one in verb.params)}
    assert section.startswith("Locks\n") and asking - {"diff"} <= said


@pytest.mark.parametrize("name", EVERY)
def test_help_shows_no_markup(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run([*name.split()[1:], "-h"]) == 0
    said = capsys.readouterr().out
    assert "\\" not in said and "\b" not in said and said.startswith(f"Usage: {name} ")


@pytest.mark.parametrize("name", EVERY)
def test_arguments_that_may_be_left_out_are_in_brackets(name: str) -> None:
    command = EVERY[name]
    context = click.Context(command, info_name=name, help_option_names=["-h", "--help"])
    for one in command.params:
        if isinstance(one, click.Argument):
            shown = one.make_metavar(context)
            assert shown.startswith("[") is not one.required, f"{name} {shown}"


_ENDS = """
import sys, threading
from srprov.cli import main
from srprov.linear_regex import compiled

begun = threading.Event()

def search():
    one = compiled("never")
    while True:
        one.search("x" * 200)
        begun.set()

def run():
    for _ in range(3):
        threading.Thread(target=search, daemon=True).start()
    begun.wait()
    print("said")
    return 130

main.run = run
main.entry()
"""


def test_threads_that_still_match_lines_do_not_abort_the_process() -> None:
    """An interpreter that is taken apart ends threads in the middle of C++, which ends the process with SIGABRT."""
    for _ in range(5):
        done = subprocess.run([sys.executable, "-c", _ENDS], capture_output=True, text=True, timeout=60)
        assert (done.returncode, done.stdout, done.stderr) == (130, "said\n", "")
