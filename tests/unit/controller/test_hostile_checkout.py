"""A checkout of a stranger's costs no time before it is known which commit it stands on."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from srprov.git import head
from srprov.git.head import checkout_of
from tests.bounded import bounded

COMMIT = "7e57" * 10
MIB = 1024 * 1024


def checkout(folder: Path, name: str = "refs/heads/x") -> Path:
    """Make what git takes for a repository, and return the folder of it."""
    for inner in ("objects", "refs/heads"):
        (folder / ".git" / inner).mkdir(parents=True)
    (folder / ".git/HEAD").write_text(f"ref: {name}\n")
    return folder / ".git"


def commit_of(folder: Path) -> str:
    found = bounded(lambda: checkout_of(str(folder)), cpu_s=1.0, memory=100 * MIB)
    return found.commit if found else ""


def submodule(folder: Path, config: str) -> Path:
    """Make a checkout whose repository lies elsewhere, with settings of its own."""
    checkout(folder / "outer")
    own, top = folder / "outer/.git/modules/s", folder / "outer/s"
    checkout(own.parent / "made").rename(own)
    (own / "HEAD").write_text(COMMIT + "\n")
    (own / "config").write_text(config)
    top.mkdir()
    (top / ".git").write_text("gitdir: ../.git/modules/s\n")
    return top


@pytest.mark.parametrize("config", [f"worktree = a{' ' * 65_000}b\n", f"worktree{' ' * 65_000}b\n", "=\n" * 32_000])
def test_settings_of_any_form_are_passed_over(tmp_path: Path, config: str) -> None:
    assert commit_of(submodule(tmp_path, config)) == ""


@pytest.mark.parametrize(
    "line", ["\tworktree = ../../../s", "worktree=../../../s \t", "[core]\n worktree = \t../../../s"]
)
def test_the_worktree_of_settings_is_found(tmp_path: Path, line: str) -> None:
    assert commit_of(submodule(tmp_path, f"[core]\n\tbare = false\n{line}\nworktree = x\n")) == COMMIT


@pytest.mark.parametrize("line", [b"\n", b" refs/heads/x \n", b"refs/heads/x\n", b" refs/heads/y\n", b" "])
def test_a_list_of_references_is_searched_as_it_is(tmp_path: Path, line: bytes) -> None:
    packed = checkout(tmp_path) / "packed-refs"
    packed.write_bytes(line * (32 * MIB // len(line)))
    assert commit_of(tmp_path) == ""


@pytest.mark.parametrize(
    ("content", "commit"),
    [
        (f"# pack-refs with: peeled fully-peeled sorted \n{'0' * 40} refs/heads/xx\n{COMMIT} refs/heads/x\n", COMMIT),
        (f"{COMMIT} refs/heads/x\n^{'1' * 40}\n{'0' * 40} refs/heads/y\n", COMMIT),
        (f"{COMMIT}{COMMIT[:24]} refs/heads/x\n", COMMIT + COMMIT[:24]),
        (f"{'0' * 40} refs/heads/y\n{COMMIT}{COMMIT[:25]} refs/heads/x\n", ""),
        (f"0{COMMIT} refs/heads/x\n", ""),
        (f"{'0' * 40} {COMMIT} refs/heads/x\n", ""),
        (f"{COMMIT} refs/heads/x", ""),
        (" refs/heads/x\n", ""),
    ],
)
def test_a_reference_is_one_line_of_the_list(tmp_path: Path, content: str, commit: str) -> None:
    (checkout(tmp_path) / "packed-refs").write_text(content)
    assert commit_of(tmp_path) == commit


def test_objects_beyond_number_are_not_looked_at(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Folders, and files in them; of the latter there are more in an honest repository, where nobody packs them."""
    git = checkout(tmp_path)
    (git / "HEAD").write_text(COMMIT + "\n")
    for number in range(256):
        (git / f"objects/{number:02x}").mkdir()
    assert commit_of(tmp_path) == COMMIT
    looked = list[str]()
    entries = head._entries
    monkeypatch.setattr(head, "_entries", lambda folder: looked.append(folder) or entries(folder))
    for number in range(3000):
        (git / f"objects/x{number}").mkdir()
    assert checkout_of(str(tmp_path)) is None
    assert len(looked) <= head._MOST_FOLDERS + 2, len(looked)


def test_files_beyond_number_are_not_looked_at(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    git = checkout(tmp_path)
    (git / "HEAD").write_text(COMMIT + "\n")
    (git / "objects/00").mkdir()
    for number in range(99):
        (git / f"objects/00/{number}").touch()
    monkeypatch.setattr(head, "_MOST_OBJECTS", 100)
    assert commit_of(tmp_path) == COMMIT
    (git / "objects/00/99").touch()
    assert commit_of(tmp_path) == ""


@pytest.mark.parametrize("name", ["refs", "objects", ""])
def test_what_a_link_of_a_repository_leads_to_shows_in_nothing(tmp_path: Path, name: str) -> None:
    """A run's record has the commit: with a link to a folder of the user's it told whether that is there."""
    top, mine = tmp_path / "top", tmp_path / "mine"
    checkout(top)
    (top / ".git/HEAD").write_text(COMMIT + "\n")
    assert commit_of(top) == COMMIT
    checkout(tmp_path / "other").rename(mine)
    (mine / "HEAD").write_text(COMMIT + "\n")
    place = top / ".git" / name
    shutil.rmtree(place)
    place.symlink_to(mine / name)
    assert commit_of(top) == ""
    shutil.rmtree(mine)
    assert commit_of(top) == ""


@pytest.mark.parametrize("to", ["", "folder", "link"])
def test_no_folder_on_the_way_to_a_repository_is_looked_at(tmp_path: Path, to: str) -> None:
    top = submodule(tmp_path, "[core]\n\tworktree = ../../../../mine/../outer/s\n")
    (top / ".git").write_text("gitdir: ../../mine/../outer/.git/modules/s\n")
    mine = tmp_path / "mine"
    if to == "folder":
        mine.mkdir()
    elif to == "link":
        mine.symlink_to("/etc")
    assert commit_of(top) == COMMIT
