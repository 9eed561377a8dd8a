"""What is written lies below the new folder, with the modes of the experiment's files."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.errors import UsageError
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


def test_a_link_leads_no_file_elsewhere(tmp_path: Path) -> None:
    """A file below a link is refused: links come last, and so the folder is one, and there already."""
    (tmp_path / "victim").mkdir()
    with pytest.raises(UsageError):
        write(str(tmp_path / "out"), [File(path="a", link="../victim"), File(path="a/x", content=b"1")])
    assert list((tmp_path / "victim").iterdir()) == []
