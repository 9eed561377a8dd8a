"""The commit of a record is one, whatever the repository's folder is called, and a hostile repository costs seconds."""

from __future__ import annotations

import os
import subprocess
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from srprov.controller.input_commit import source_commit
from srprov.controller.input_files import InputFile


def planned(folder: Path) -> Any:
    experiment = SimpleNamespace(file=str(folder / "x.edf"), folder=str(folder))
    return SimpleNamespace(definitions=SimpleNamespace(experiment=experiment))


def committed(folder: Path) -> str:
    """Make a repository with one file, and return its commit."""
    folder.mkdir()
    (folder / "x.edf").write_text("edf: 1\n")
    git = ["git", "-C", str(folder), "-c", "user.name=a", "-c", "user.email=a@b"]
    for words in (["init", "-q"], ["add", "."], ["commit", "-qm", "one"]):
        subprocess.run([*git, *words], check=True)
    return subprocess.run([*git, "rev-parse", "HEAD"], check=True, capture_output=True, text=True).stdout.strip()


@pytest.mark.parametrize("name", ["plain", "two\nlines", "line\u2028separator", "ends in one\n"])
def test_a_commit_is_that_of_the_repository(tmp_path: Path, name: str) -> None:
    commit = committed(tmp_path / name)
    files = {"x.edf": InputFile(content=b"edf: 1\n"), "y": InputFile(content=b"")}
    found = source_commit(planned(tmp_path / name), files)
    assert found is not None
    assert (found["commit"], found["changed"], found["added"]) == (commit, [], ["y"])


def test_a_repository_that_waits_for_a_pipe_is_given_up_soon(tmp_path: Path) -> None:
    committed(tmp_path / "r")
    os.mkfifo(tmp_path / "pipe")
    with (tmp_path / "r" / ".git" / "config").open("a") as stream:
        stream.write(f"[include]\n\tpath = {tmp_path}/pipe\n")
    begun = time.monotonic()
    found = source_commit(planned(tmp_path / "r"), {})
    assert found is not None and found["commit"] is None and found["problem"]
    assert time.monotonic() - begun < 8
