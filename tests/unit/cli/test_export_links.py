"""An export is there to be copied, and what copies it may follow links: none leads out of the part in which it lies."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from srprov.cli.main import run

INVENTORY = "all: {hosts: {r1: {}}}\n"
LENT = ("--allow", "host-path")
"""A seed that its service writes to is a folder of the export."""
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
    code = run(["export", "compose", "e.edf", "-o", "out", *LENT])
    said = capsys.readouterr().err
    if (project / "out").exists():
        shutil.copytree(project / "out", project / "copy", ignore_dangling_symlinks=True)
        assert "canary" not in lines_of(project / "copy")
    assert (code, "/map would lead out of " in said) == (5, True), said
    assert not (project / "out").exists()


def test_a_link_that_stays_in_its_part_is_written(project: Path) -> None:
    (project / "ctx" / "sub" / "link").symlink_to("../f")
    (project / SEED / "link").symlink_to("f")
    assert run(["export", "compose", "e.edf", "-o", "out", *LENT]) == 0
    assert (project / "out" / "build" / "ctx" / "sub" / "link").read_text() == "own"
    assert (project / "out" / "volumes" / "cfg" / "link").read_text() == "own"
    (project / "ctx" / "out").symlink_to("/etc/hosts")
    (project / "ctx" / ".dockerignore").write_text("out\n")
    assert run(["export", "compose", "e.edf", "-o", "again", *LENT]) == 0


@pytest.mark.parametrize("place", ["build/other", "build/b"])
def test_no_link_leads_from_what_one_image_is_built_from_to_that_of_another(
    project: Path, capsys: pytest.CaptureFixture[str], place: str
) -> None:
    """A CDF of a stranger's, as one of git, has what lies with it alone; in an export others lie beside it."""
    (project / "b").mkdir()
    (project / "b" / "Dockerfile").write_text("FROM busybox\nCOPY private /p\n")
    (project / "b" / "private").write_text("canary")
    edf = (project / "e.edf").read_text()
    (project / "e.edf").write_text(edf.replace("services: {", "services: {b: {cdf: b/Dockerfile}, "))
    (project / "ctx" / "map").symlink_to(f"../{place.partition('/')[2]}/private")
    assert run(["export", "compose", "e.edf", "-o", "out", *LENT]) == 5
    assert "the link build/ctx/map would lead out of build/ctx/" in capsys.readouterr().err
    (project / "ctx" / "map").unlink()
    (project / SEED / "map").symlink_to("../other/f")
    assert run(["export", "compose", "e.edf", "-o", "out", *LENT]) == 5
    assert "the link volumes/cfg/map would lead out of volumes/cfg/" in capsys.readouterr().err


def test_links_among_what_is_mounted_stay_as_they_are_in_the_project(project: Path) -> None:
    (project / "shared").mkdir()
    (project / "shared" / "f").write_text("own")
    (project / "conf").mkdir()
    (project / "conf" / "link").symlink_to("../shared/f")
    (project / "e.edf").write_text(
        "edf: 1\nname: demo\nservices: {a: {image: busybox, volumes: ['./conf:/conf', './shared:/shared']}}\n"
    )
    assert run(["export", "compose", "e.edf", "-o", "out", *LENT]) == 0
    assert (project / "out" / "files" / "conf" / "link").read_text() == "own"
