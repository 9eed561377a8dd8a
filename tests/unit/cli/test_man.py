"""The manual page: all verbs and options, in a form that man's own checkers take."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import click
import pytest

from srprov.cli.commands import verbs
from srprov.cli.main import cli, run
from srprov.cli.manual import EXIT_CODES, page
from srprov.errors import SrprovError

README = Path(__file__).resolve().parents[3] / "README.md"
CHECKERS = {
    "mandoc": ["mandoc", "-Tlint", "-W", "style", "{}"],
    "man": ["man", "--warnings", "-E", "UTF-8", "-l", "-Tutf8", "-Z", "{}"],
}


@pytest.mark.parametrize("program", CHECKERS)
def test_checkers_of_manual_pages_find_nothing(program: str, tmp_path: Path) -> None:
    if shutil.which(program) is None:
        pytest.skip(f"{program} is not installed")
    path = tmp_path / "srprov.1"
    path.write_text(page(cli), encoding="utf-8")
    done = subprocess.run([word.format(path) for word in CHECKERS[program]], capture_output=True, text=True)
    said = [line for line in (*done.stderr.splitlines(), *done.stdout.splitlines()) if f"{path}:" in line]
    assert (said, done.returncode) == ([], 0)


def test_every_verb_and_option_stands_there(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["man"]) == 0
    shown = capsys.readouterr().out.replace("\\-", "-").replace("\\&", "")
    listed = list(verbs(cli))
    assert {"apply", "lab up", "import compose"} <= {verb.name for verb in listed}
    for verb in listed:
        section = shown.partition(f".SS srprov {verb.name}")[2].partition(".SS ")[0]
        missing = [name for option in verb.options for name in option.names if f"\\fB{name}\\fR" not in section]
        # click keeps the names that a verb was first asked for its help by
        assert section and "--help" in missing and set(missing) <= {"-h", "--help"}, verb.name


def test_no_text_of_the_page_is_a_command_of_roff() -> None:
    group = click.Group("srprov")
    hostile = "One.\n\n\b\n.so /etc/passwd\n'nf\n\\fBbold\n"
    group.add_command(click.Command("odd", help=hostile, callback=lambda: None))
    lines = page(group).splitlines()
    assert "\\&.so /etc/passwd" in lines and "\\efBbold" in lines and "\\(aqnf" in lines


def test_exit_codes_are_those_of_the_readme_and_of_errors() -> None:
    section = README.read_text(encoding="utf-8").partition("## Exit codes")[2].partition("\n## ")[0]
    told = re.findall(r"^\| (\d+) \|", section, re.MULTILINE)
    assert list(EXIT_CODES) == told
    kinds = [SrprovError]
    for kind in kinds:
        kinds += kind.__subclasses__()
    assert {str(kind.exit_code) for kind in kinds} <= EXIT_CODES.keys()


def test_an_option_has_its_variable() -> None:
    every = {option.variable for verb in verbs(cli) for option in verb.options}
    assert {"SRPROV_APPLY_INVENTORY", "SRPROV_PLAN_OUT", "SRPROV_EXPORT_COMPOSE_OUT", "SRPROV_RUNS", ""} <= every
