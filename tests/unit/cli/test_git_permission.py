"""A stranger's repository is fetched when the user allowed it, and not before; then its files are in the plan."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from srprov.cli.main import run

EDF = "edf: 1\nname: demo\nservices: {a: {cdf: a.cdf}}\n"


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "e.edf").write_text(EDF)
    (tmp_path / "inv.yml").write_text("all: {hosts: {r1: {ansible_host: 127.0.0.1, ansible_port: 1}}}\n")
    monkeypatch.chdir(tmp_path)
    for name in ("HOME", "XDG_CACHE_HOME", "XDG_STATE_HOME"):
        monkeypatch.setenv(name, str(tmp_path / "home"))
    return tmp_path


@pytest.mark.parametrize("verb", [["plan"], ["apply", "--yes"]])
def test_git_does_not_run_unasked(
    here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], verb: list[str]
) -> None:
    """Exit 9 names the service, the address and the flag."""
    (here / "a.cdf").write_text("cdf: 1\nbase: x\nrepositories: [{git: https://h/x.git, ref: v1, path: /x}]\n")
    (here / "git").write_text(f"#!/bin/sh\ntouch {here}/ran\n")
    (here / "git").chmod(0o755)
    monkeypatch.setenv("PATH", f"{here}:{os.environ['PATH']}")
    assert run([*verb, "e.edf", "-i", "inv.yml"]) == 9
    said = capsys.readouterr().err
    assert "a: git (https://h/x.git, v1: fetched here, its files go into the image)" in said
    assert "--allow git" in said
    assert run(["validate", "e.edf", "a.cdf"]) == 0
    assert not (here / "ran").exists()


def test_a_plan_holds_the_files_of_a_commit_and_a_file_of_it_says_so(here: Path) -> None:
    """A branch is told with its commit, a whole commit is not; what cannot be fetched is told at its line."""
    code = here / "code"
    for words in (
        ["init", "-q", "-b", "main", str(code)],
        ["-C", str(code), "commit", "-q", "--allow-empty", "-m", "x"],
    ):
        subprocess.run(["git", "-c", "user.name=a", "-c", "user.email=a@b.c", *words], check=True)
    (code / "f").write_text("content")
    for words in (["add", "f"], ["commit", "-qm", "y"]):
        subprocess.run(["git", "-C", str(code), "-c", "user.name=a", "-c", "user.email=a@b.c", *words], check=True)
    commit = subprocess.run(["git", "-C", str(code), "rev-parse", "HEAD"], capture_output=True, text=True, check=True)
    sha = commit.stdout.strip()

    def plan(ref: str, *more: str) -> subprocess.CompletedProcess[str]:
        (here / "a.cdf").write_text(
            f"cdf: 1\nbase: x\nrepositories:\n- {{git: 'file://{code}', ref: {ref}, path: /x}}\n"
        )
        faked = [sys.executable, "-m", "tests.unit.cli.faked", "plan", "e.edf", "-i", "inv.yml", *more]
        env = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])}
        return subprocess.run(faked, capture_output=True, text=True, env=env, check=False)

    pinned = plan(sha, "--allow", "git", "--allow", "outside", "--json")
    branch = plan("main", "--allow", "git", "--allow", "outside", "-o", "plan.json", "--json")
    assert (pinned.returncode, branch.returncode) == (0, 0), (pinned, branch)
    one, two = json.loads(pinned.stdout), json.loads(branch.stdout)
    note = f"main of file://{code} is commit {sha[:12]} now"
    assert note in two["notes"] and "is commit" not in str(one["notes"])
    images = {step["name"] for made in (one, two) for step in made["steps"] if step["module"] == "image"}
    assert len(images) == 1, "the same commit, the same tag"
    kept = json.loads((here / "plan.json").read_text())
    assert {
        "kind": "git",
        "service": "a",
        "what": f"file://{code}, main: fetched here, its files go into the image",
    } in [dict(sorted(one.items())) for one in kept["permissions"]]
    nothing = plan("nothing", "--allow", "git", "--allow", "outside")
    assert nothing.returncode == 5
    assert "a.cdf:4" in nothing.stderr and f"file://{code}: it has no branch or tag 'nothing'" in nothing.stderr
