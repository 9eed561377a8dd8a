"""Git is asked of the repository that was looked at, and of none that it would find by itself."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from srprov.controller.input_commit import source_commit
from srprov.controller.input_files import InputFile
from srprov.git import lent, program
from tests.bounded import within
from tests.unit.controller.test_input_commit import committed, planned

NOBODY = 65534


def as_user(folder: Path, ask: Callable[[], object]) -> str:
    """Return what a function says to a user who owns a folder, and is not root: root may enter every folder."""
    if os.geteuid():
        return repr(ask())
    reads, writes = os.pipe()
    if (child := os.fork()) == 0:
        try:
            subprocess.run(["chown", "-R", f"{NOBODY}:{NOBODY}", str(folder)], check=True)
            os.setgroups([])
            os.setresgid(NOBODY, NOBODY, NOBODY)
            os.setresuid(NOBODY, NOBODY, NOBODY)
            os.write(writes, repr(ask()).encode())
        finally:
            os._exit(0)
    os.close(writes)
    with os.fdopen(reads) as told:
        said = told.read()
    os.waitpid(child, 0)
    return said


@pytest.fixture
def open_folder() -> Iterator[Path]:
    """Yield a folder that another user may enter, too."""
    folder = Path(tempfile.mkdtemp(dir="/tmp"))
    folder.chmod(0o755)
    yield folder
    subprocess.run(["chmod", "-R", "u+rwx", str(folder)], check=True)
    shutil.rmtree(folder)


@pytest.mark.parametrize("closed", ["refs", "objects"])
@pytest.mark.parametrize("other", ["bare", "above"])
def test_git_takes_no_other_repository_than_the_one_that_was_looked_at(
    open_folder: Path, closed: str, other: str
) -> None:
    """Git passes over a `.git` whose folders it may not enter, and takes the checkout for bare, or what is above."""
    commit = committed(open_folder / "private")
    private = open_folder / "private/.git"
    top = open_folder / ("nav" if other == "bare" else "private/nav")
    for folder in (top / ".git", *([top] if other == "bare" else [])):
        for name in ("refs", "objects/info"):
            (folder / name).mkdir(parents=True)
        (folder / "HEAD").write_text(commit + "\n")
    if other == "bare":
        (top / "objects/info/alternates").write_text(f"{private}/objects\n")
    (top / ".git" / closed).chmod(0o644)
    said = as_user(open_folder, lambda: source_commit(planned(top), {"x.edf": InputFile(content=b"edf: 1\n")}))
    assert "'commit': None" in said and commit not in said


def test_a_worktree_s_objects_are_those_that_were_looked_at(tmp_path: Path) -> None:
    """Of the line that says where they are git leaves out all that ends it: here, a part of a folder's name."""
    commit = committed(tmp_path / "private")
    top, store, other = tmp_path / "nav", tmp_path / "store\n", tmp_path / "store"
    for folder in (top, *(one / name for one in (store, other) for name in ("objects/info", "refs", "worktrees/w"))):
        folder.mkdir(parents=True)
    (other / "objects/info/alternates").write_text(f"{tmp_path}/private/.git/objects\n")
    own = store / "worktrees/w"
    for name, says in {"HEAD": commit, "gitdir": f"{top}/.git", "commondir": f"{store}\n"}.items():
        (own / name).write_text(says)
    (top / ".git").write_text(f"gitdir: {own}")
    for one in (store, other):
        (one / "HEAD").write_text(commit)
    found = source_commit(planned(top), {"x.edf": InputFile(content=b"edf: 1\n")})
    assert found is not None and found["commit"] is None


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give files away")
@pytest.mark.parametrize("theirs", [".", ".git"])
def test_a_repository_of_another_user_s_has_no_commit(tmp_path: Path, theirs: str) -> None:
    """Git asks whose it is only of one that it finds by itself."""
    committed(tmp_path / "nav")
    os.chown(tmp_path / "nav" / theirs, NOBODY, NOBODY)
    found = source_commit(planned(tmp_path / "nav"), {})
    assert found is not None and found["commit"] is None


@pytest.mark.parametrize("matches", ["S", "X"])
def test_no_settings_of_a_strangers_lead_git_to_other_files(tmp_path: Path, matches: str) -> None:
    """By `include` and a condition, one bit of each record told whether a file of the user's holds a word."""
    commit = committed(tmp_path / "nav")
    secret, bad, pipe = (tmp_path / name for name in ("secret", "bad", "pipe"))
    secret.write_text('[remote "origin"]\n\turl = https://ci:Secret@git.example/x\n')
    bad.write_text("[core]\n\tcompression = 999\n")
    os.mkfifo(pipe)
    config = tmp_path / "nav/.git/config"
    condition = f'"hasconfig:remote.*.url:https://ci:{matches}*/**"'
    included = f"[include]\n\tpath = {secret}\n[includeIf {condition}]\n\tpath = {bad}\n[include]\n\tpath = {pipe}\n"
    config.write_text(config.read_text() + included)
    found = source_commit(planned(tmp_path / "nav"), {"x.edf": InputFile(content=b"edf: 1\n")})
    assert found is not None and found["commit"] == commit


def test_git_gets_loose_objects_and_packs_and_no_list_that_names_other_files(tmp_path: Path) -> None:
    """A `multi-pack-index` names packs of other repositories by `..`, and a chain of graphs any file."""
    commit = committed(tmp_path / "nav")
    objects = tmp_path / "nav/.git/objects"
    git = ["git", "-C", str(tmp_path / "nav")]
    for words in ("repack -adq", "commit-graph write --reachable --split", "multi-pack-index write"):
        subprocess.run([*git, *words.split()], check=True, capture_output=True)
    assert (objects / "pack/multi-pack-index").exists() and (objects / "info/commit-graphs").exists()
    with lent.repository(commit, str(objects)) as folder:
        found = sorted(str(one.relative_to(folder)) for one in Path(folder, "objects").rglob("*"))
    (idx, pack) = (f"objects/pack/{one.name}" for one in sorted((objects / "pack").glob("pack-*.[ip][da]*")))
    assert found == ["objects/pack", idx, pack]
    (objects / "pack/multi-pack-index").write_bytes(b"MIDX" + b"\xff" * 100)
    told = source_commit(planned(tmp_path / "nav"), {"x.edf": InputFile(content=b"edf: 1\n")})
    assert told is not None and told["commit"] == commit


def test_a_repository_of_very_many_packs_is_refused_in_time(tmp_path: Path) -> None:
    """Each was linked, and the links removed, while the record of a run waited."""
    commit = committed(tmp_path / "nav")
    packs = tmp_path / "nav/.git/objects/pack"

    def add(numbers: range) -> None:
        for number in numbers:
            (packs / f"pack-{number:040x}.pack").touch()
            (packs / f"pack-{number:040x}.idx").touch()

    add(range(1000))
    with lent.repository(commit, str(packs.parent)) as folder:
        links = [one.path for one in os.scandir(f"{folder}/objects/pack")]
        assert len(links) == 2000 and all(map(os.path.exists, links))
        assert max(len(os.readlink(one)) for one in links) < 60  # ext4 keeps those in the inode
    add(range(1000, 5000))
    many = str(packs.parent)
    with within(1), pytest.raises(OSError, match="more than 2000 names of packs"), lent.repository(commit, many):
        pass
    with within(1):
        told = source_commit(planned(tmp_path / "nav"), {})
    assert told is not None and told["commit"] is None and "cannot list" in told["problem"]


def test_names_of_objects_may_be_of_the_longer_kind(tmp_path: Path) -> None:
    commit = committed(tmp_path / "nav", "--object-format=sha256")
    found = source_commit(planned(tmp_path / "nav"), {"x.edf": InputFile(content=b"edf: 1\n")})
    assert found is not None and found["commit"] == commit and len(commit) == 64


@pytest.mark.parametrize("bare", [False, True])
def test_git_never_looks_for_a_repository(tmp_path: Path, bare: bool) -> None:
    subprocess.run(["git", "init", "-q", *(["--bare"] if bare else []), str(tmp_path / "r")], check=True)
    with pytest.raises(program.GitError, match="not a git repository"):
        program.run(["-C", str(tmp_path / "r"), "rev-parse", "--git-dir"], most=1000, seconds=10)
