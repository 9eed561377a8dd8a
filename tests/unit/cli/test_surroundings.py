"""Variables of the environment that would make the folder at hand, a stranger's perhaps, the user's own."""

from __future__ import annotations

import os
import pwd
from pathlib import Path

import pytest

from srprov.cli.main import run
from srprov.cli.surroundings import keep_to_whole_paths
from srprov.lab.machine import find

HOME = pwd.getpwuid(os.geteuid()).pw_dir


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        ({}, {"PATH": os.defpath}),
        ({"PATH": "/a;b", "LD_LIBRARY_PATH": "/opt/x;lib;"}, {"PATH": "/a;b", "LD_LIBRARY_PATH": "/opt/x"}),
        ({"HOME": "/home/ada", "PATH": "/bin:/usr/bin"}, {"HOME": "/home/ada", "PATH": "/bin:/usr/bin"}),
        ({"PATH": ":/bin:", "LD_LIBRARY_PATH": "/opt/x:"}, {"PATH": "/bin", "LD_LIBRARY_PATH": "/opt/x"}),
        ({"PATH": "bin:./x:~/bin:/a b"}, {"PATH": "/a b"}),
        ({"PATH": ".", "LD_LIBRARY_PATH": ":"}, {"PATH": os.defpath, "LD_LIBRARY_PATH": "/nonexistent"}),
    ],
)
def test_lists_of_folders_have_whole_paths_alone(given: dict[str, str], kept: dict[str, str]) -> None:
    keep_to_whole_paths(given)
    assert given == kept


@pytest.mark.parametrize("home", ["", ".", "home"])
def test_no_home_is_the_folder_at_hand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], home: str
) -> None:
    """What a project has in `.config` would be the user's own word, and its playbooks be asked by root."""
    folder = tmp_path / home / ".config" / "srprov"
    folder.mkdir(parents=True)
    (folder / "srprov.toml").write_text('yes = true\nallow = ["playbook", "privileged"]\n')
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)
    monkeypatch.setenv("HOME", home)
    assert run(["config", "apply"]) == 0
    assert "privileged" not in capsys.readouterr().out and os.environ["HOME"] == HOME


def test_no_program_of_the_folder_at_hand_is_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "srprov-test-program").write_text("#!/bin/sh\n")
    (tmp_path / "srprov-test-program").chmod(0o755)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", f"{os.environ['PATH']}:")
    assert find("srprov-test-program")
    assert run(["schema", "edf"]) == 0
    assert find("srprov-test-program") is None
