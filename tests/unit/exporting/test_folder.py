"""What is written lies below the new folder, with the modes of the experiment's files."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

from srprov.errors import UsageError
from srprov.exporting import folder
from srprov.exporting.folder import write
from srprov.exporting.model import File


def test_files_folders_and_links_are_written_as_they_are(tmp_path: Path) -> None:
    target = tmp_path / "out"
    files = [File(path="a/run", content=b"x", mode=0o755), File(path="a/b", link="run"), File(path="e", is_folder=True)]
    write(str(target), files)
    assert (target / "a" / "run").read_bytes() == b"x"
    assert (target / "a" / "run").stat().st_mode & 0o777 == 0o755
    assert (target / "a").stat().st_mode & 0o777 == 0o755
    assert (target / "a" / "b").readlink() == Path("run")
    assert (target / "e").is_dir()
    assert target.stat().st_mode & 0o077 == 0


def test_a_folder_with_something_in_it_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("1")
    with pytest.raises(UsageError, match="not empty"):
        write(str(tmp_path), [File(path="mine", content=b"2")])
    assert (tmp_path / "mine").read_text() == "1"


@pytest.mark.parametrize("path", ["../x", "/etc/x", "a//b", "a/../../x", "./x", ""])
def test_no_path_leads_out(tmp_path: Path, path: str) -> None:
    with pytest.raises(UsageError, match="no path of an export"):
        write(str(tmp_path / "out"), [File(path=path, content=b"1")])


@pytest.mark.parametrize(
    "names",
    [
        ("HEAD", "config", "objects/x", "refs/x"),
        ("head", "Objects", "refs"),
        ("HEAD", "commondir"),
        (".git/config",),
        (".GIT",),
        (".hg/hgrc",),
    ],
)
def test_nothing_that_is_exported_makes_a_repository(tmp_path: Path, names: tuple[str, ...]) -> None:
    """A repository that an experiment builds with holds another one's files: git ran here what its settings name."""
    files = [File(path=f"build/a/repositories/0/src/{name}", content=b"x") for name in names]
    with pytest.raises(UsageError, match="a repository here could name programs"):
        write(str(tmp_path / "out"), files)
    assert not (tmp_path / "out").exists()


def test_files_that_make_no_repository_are_written(tmp_path: Path) -> None:
    names = ("HEAD", "a/objects/x", "a/HEAD/x", "a/refs", "b/HEAD", "b/objects-3/x", "b/refs/x", "cvs/x", ".gitignore")
    write(str(tmp_path / "out"), [File(path=name, content=b"x") for name in names])
    assert (tmp_path / "out/b/HEAD").is_file()


def test_a_link_leads_no_file_elsewhere(tmp_path: Path) -> None:
    """A file below a link is refused: links come last, and so the folder is one, and there already."""
    (tmp_path / "victim").mkdir()
    with pytest.raises(UsageError):
        write(str(tmp_path / "out"), [File(path="a", link="../victim"), File(path="a/x", content=b"1")])
    assert list((tmp_path / "victim").iterdir()) == []


def test_a_link_that_is_put_in_the_folder_s_place_meanwhile_leads_nothing_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever may write to the folder above: files of the export were written where the link led."""
    (tmp_path / "own").mkdir()
    once = folder._write

    def swapping(*given: Any) -> None:
        once(*given)
        if not (tmp_path / "moved").exists():
            (tmp_path / "out").rename(tmp_path / "moved")
            (tmp_path / "out").symlink_to(tmp_path / "own")

    monkeypatch.setattr(folder, "_write", swapping)
    write(str(tmp_path / "out"), [File(path=name, content=b"x") for name in ("a", "b", "c")])
    assert os.listdir(tmp_path / "own") == [] and len(os.listdir(tmp_path / "moved")) == 3


def test_a_folder_to_which_others_may_write_is_not_filled(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out").chmod(0o777)
    with pytest.raises(UsageError, match="others may write to it"):
        write(str(tmp_path / "out"), [File(path="a", content=b"x")])
