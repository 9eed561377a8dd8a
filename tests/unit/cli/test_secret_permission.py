"""A stranger's EDF reads nothing of the controller, and runs nothing there, before the user allowed it."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.cli.main import run

EDF = """\
edf: 1
name: demo
secrets:
  token: {command: ["touch", "ran"]}
services:
  a: {image: busybox, secrets: [token]}
"""


@pytest.mark.parametrize("verb", [["plan"], ["apply", "--yes"]])
def test_a_command_of_the_edf_does_not_run_unasked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], verb: list[str]
) -> None:
    """Exit 9 names the service, the command and the flag, and the command did not run."""
    (tmp_path / "e.edf").write_text(EDF)
    (tmp_path / "inv.yml").write_text("all: {hosts: {r1: {ansible_host: 127.0.0.1, ansible_port: 1}}}\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))

    code = run([*verb, "e.edf", "-i", "inv.yml"])

    said = capsys.readouterr().err
    assert code == 9
    assert f"a: secret (token, from the command touch ran, in {tmp_path})" in said
    assert "--allow secret" in said
    assert not (tmp_path / "ran").exists()
