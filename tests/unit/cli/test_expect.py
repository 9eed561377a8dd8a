"""`apply --expect`: the plan that was shown with this hash, or none; on robots in memory, as a program of its own."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Give the folder of an experiment for one robot."""
    (tmp_path / "e.edf").write_text("edf: 1\nname: hello\nservices:\n  a: {image: busybox}\n")
    (tmp_path / "inv.yml").write_text("all: {hosts: {r1: {ansible_host: 10.0.0.1}}}\n")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    for name in ("XDG_STATE_HOME", "XDG_CONFIG_HOME"):
        monkeypatch.setenv(name, str(tmp_path))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[3]))
    monkeypatch.setenv("FAKED_STATE", "running.json")
    return tmp_path


def srprov(*words: str) -> subprocess.CompletedProcess[str]:
    """Run it with new robots, on which nothing is."""
    program = [sys.executable, "-m", "tests.unit.cli.faked", *words, "-i", "inv.yml"]
    return subprocess.run(program, capture_output=True, text=True, check=False, timeout=60)


def test_the_plan_that_was_reviewed_is_done_and_no_other(folder: Path) -> None:
    """Text, JSON and Markdown tell one hash; another one is refused with 6, and nothing runs; what is none with 5."""
    shown = json.loads(srprov("plan", "e.edf", "--json").stdout)["hash"]
    assert f"Its hash, for `apply --expect`: {shown}" in srprov("plan", "e.edf").stdout
    assert f"<!-- srprov-plan sha256:{shown} -->" in srprov("plan", "e.edf", "--format", "markdown").stdout

    (folder / "e.edf").write_text("edf: 1\nname: hello\nservices:\n  a: {image: busybox, command: [other]}\n")
    other = srprov("apply", "e.edf", "--yes", "--settle", "0", "--expect", shown)
    assert other.returncode == 6, other
    assert "not the plan that was reviewed" in other.stderr
    assert json.loads(Path("running.json").read_text()) == []
    assert srprov("apply", "e.edf", "--yes", "--expect", "latest").returncode == 5

    (folder / "e.edf").write_text("edf: 1\nname: hello\nservices:\n  a: {image: busybox}\n")
    done = srprov("apply", "e.edf", "--yes", "--settle", "0", "--expect", shown[:32])
    assert done.returncode == 0, done
    assert json.loads(Path("running.json").read_text()) == [["a", "r1"]]
