"""An export is there to be copied, and what copies it may follow links: none leads out of the part in which it lies."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from srprov.cli.main import run

INVENTORY = "all: {hosts: {r1: {}}}\n"
SEED = "a/b/c/d/e/seed"
EDF = "edf: 1\nname: demo\nvolumes: {cfg: {seed: SEED}}\nservices: {a: {cdf: ctx/Dockerfile, volumes: ['cfg:/c']}}\n"


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a project of a stranger's, in a folder of whose user there is a file."""
    home = tmp_path / "home"
    folder = home / "nav"
    for one in ("ctx/sub", SEED):
        (folder / one).mkdir(parents=True)
    (home / "secret.txt").write_text("canary")
    (folder / "e.edf").write_text(EDF.replace("SEED", SEED))
    (folder / "ctx" / "Dockerfile").write_text("FROM busybox\nCOPY . /ctx\n")
    for one in ("ctx/f", f"{SEED}/f"):
        (folder / one).write_text("own")
    monkeypatch.chdir(folder)
    monkeypatch.setenv("HOME", str(home))
    return folder


def lines_of(copy: Path) -> set[str]:
    """Return what a copy has that follows links."""
    return {one.read_text() for one in copy.rglob("*") if one.is_file()}


@pytest.mark.parametrize(
    ("place", "target"),
    [
        # from `out/build/ctx` and `out/volumes/cfg` these lead to the user's file; from the seed, into the project
        ("ctx/map", "../../../../secret.txt"),
        ("ctx/map", "sub/../../../../../secret.txt"),
        (f"{SEED}/map", "../../../../secret.txt"),
        ("ctx/map", "/HOME/secret.txt"),
    ],
)
def test_no_link_of_an_export_leads_out_of_its_part(
    project: Path, capsys: pytest.CaptureFixture[str], place: str, target: str
) -> None:
    """`scp -r`, by which the folder is copied to a robot, took the user's file along for the container."""
    (project / place).symlink_to(target.replace("/HOME", os.environ["HOME"]))
    code = run(["export", "compose", "e.edf", "-o", "out"])
    said = capsys.readouterr().err
    if (project / "out").exists():
        shutil.copytree(project / "out", project / "copy", ignore_dangling_symlinks=True)
        assert "canary" not in lines_of(project / "copy")
    assert (code, "/map would lead out of " in said) == (5, True), said
    assert not (project / "out").exists()


def test_a_link_that_stays_in_its_part_is_written(project: Path) -> None:
    (project / "ctx" / "sub" / "link").symlink_to("../f")
    (project / SEED / "link").symlink_to("f")
    assert run(["export", "compose", "e.edf", "-o", "out"]) == 0
    assert (project / "out" / "build" / "ctx" / "sub" / "link").read_text() == "own"
    assert (project / "out" / "volumes" / "cfg" / "link").read_text() == "own"
    (project / "ctx" / "out").symlink_to("/etc/hosts")
    (project / "ctx" / ".dockerignore").write_text("out\n")
    assert run(["export", "compose", "e.edf", "-o", "again"]) == 0
