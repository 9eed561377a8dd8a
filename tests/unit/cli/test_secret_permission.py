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

    for more in ([], ["--allow", "secret"]):
        code = run([*verb, "e.edf", "-i", "inv.yml", *more])

        said = capsys.readouterr().err
        assert code == 9
        assert f"a: secret-command (token, from the command touch ran, in {tmp_path})" in said
        assert "--allow secret-command" in said
        assert not (tmp_path / "ran").exists()


def test_a_program_of_the_user_s_takes_what_lies_in_the_folder_and_so_does_not_count_as_a_value(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """`python3 -m keyring` runs the keyring.py of the experiment; to allow values to be read is not to allow that."""
    (tmp_path / "e.edf").write_text(EDF.replace('["touch", "ran"]', "[python3, -m, keyring, get, lab, token]"))
    (tmp_path / "keyring.py").write_text("open('ran', 'w').close(); print('1234')\n")
    (tmp_path / "inv.yml").write_text("all: {hosts: {r1: {ansible_host: 127.0.0.1, ansible_port: 1}}}\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    run(["plan", "e.edf", "-i", "inv.yml", "--allow", "secret"])
    assert not (tmp_path / "ran").exists()
    run(["plan", "e.edf", "-i", "inv.yml", "--allow", "secret-command"])
    assert (tmp_path / "ran").exists(), capsys.readouterr().err
