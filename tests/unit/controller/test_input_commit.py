"""The commit of a record is one, whatever the repository's folder is called, and a hostile repository costs seconds."""

from __future__ import annotations

import os
import subprocess
import sys
import time
import zlib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from srprov.controller.input_commit import source_commit
from srprov.controller.input_files import InputFile
from srprov.git import program


def planned(folder: Path) -> Any:
    experiment = SimpleNamespace(file=str(folder / "x.edf"), folder=str(folder))
    return SimpleNamespace(definitions=SimpleNamespace(experiment=experiment))


def committed(folder: Path, *init: str) -> str:
    """Make a repository with one file, and return its commit."""
    folder.mkdir()
    (folder / "x.edf").write_text("edf: 1\n")
    git = ["git", "-C", str(folder), "-c", "user.name=a", "-c", "user.email=a@b"]
    for words in (["init", "-q", *init], ["add", "."], ["commit", "-qm", "one"]):
        subprocess.run([*git, *words], check=True)
    return subprocess.run([*git, "rev-parse", "HEAD"], check=True, capture_output=True, text=True).stdout.strip()


@pytest.mark.parametrize("name", ["plain", "worktrees", "two\nlines", "line\u2028separator", "ends in one\n"])
def test_a_commit_is_that_of_the_repository(tmp_path: Path, name: str) -> None:
    commit = committed(tmp_path / name)
    files = {"x.edf": InputFile(content=b"edf: 1\n"), "y": InputFile(content=b"")}
    found = source_commit(planned(tmp_path / name), files)
    assert found is not None
    assert (found["commit"], found["changed"], found["added"]) == (commit, [], ["y"])


def test_no_file_of_this_machine_is_told_by_way_of_a_repository(tmp_path: Path) -> None:
    commit = committed(tmp_path / "private")
    (tmp_path / "key").write_text("7e57" * 10 + "\n")
    leads = {
        "a list of references": {"HEAD": "ref: refs/heads/x\n", "packed-refs": Path("../../key")},
        "a reference": {"HEAD": "ref: refs/heads/x\n", "refs/heads/x": Path("../../../../key")},
        "a folder of references": {"HEAD": "ref: refs/heads/x\n", "refs": Path("../../private/.git/refs")},
        "HEAD": {"HEAD": Path("../../private/.git/HEAD")},
        "a path": {"HEAD": "ref: refs/../../../private/.git/refs/heads/master\n"},
        "borrowed objects": {"HEAD": "0" * 40, "objects/info/alternates": Path("../../../../key")},
        "shared references": {"HEAD": "ref: refs/heads/master\n", "commondir": str(tmp_path / "private" / ".git")},
    }
    for number, files in enumerate(leads.values()):
        top = tmp_path / str(number)
        subprocess.run(["git", "init", "-q", str(top)], check=True)
        for name, content in files.items():
            path = top / ".git" / name
            subprocess.run(["rm", "-rf", str(path)], check=True)
            path.symlink_to(content) if isinstance(content, Path) else path.write_text(content)
    for name, link in {"file": False, "link": True}.items():
        (tmp_path / name).mkdir()
        git, private = tmp_path / name / ".git", tmp_path / "private" / ".git"
        git.symlink_to(private) if link else git.write_text(f"gitdir: {private}\n")
    for top in (*map(str, range(len(leads))), "file", "link"):
        found = repr(source_commit(planned(tmp_path / top), {}))
        assert commit not in found and "7e57" not in found, top
        assert "'commit': None" in found, top


@pytest.mark.parametrize("second", ["HEAD", "refs/heads/master", "packed-refs"])
def test_no_reference_is_believed_by_a_second_name(tmp_path: Path, second: str) -> None:
    """An archive may give one of the user's own repository a name in the stranger's."""
    commit = committed(tmp_path / "private")
    private, top = tmp_path / "private/.git", tmp_path / "nav"
    subprocess.run(["git", "clone", "-q", "--no-hardlinks", str(tmp_path / "private"), str(top)], check=True)
    subprocess.run(["git", "-C", str(tmp_path / "private"), "branch", "-qM", "master"], check=True)
    subprocess.run(["git", "-C", str(top), "branch", "-qM", "master"], check=True)
    assert commit in repr(source_commit(planned(top), {}))
    if second == "packed-refs":
        subprocess.run(["git", "-C", str(tmp_path / "private"), "pack-refs", "--all"], check=True)
        subprocess.run(["rm", "-rf", str(top / ".git/packed-refs"), str(top / ".git/refs/heads/master")], check=True)
    else:
        (top / ".git" / second).unlink()
    (top / ".git" / second).hardlink_to(private / second)
    found = source_commit(planned(top), {})
    assert found is not None and found["commit"] is None


@pytest.mark.parametrize("way", ["alternates", "objects", "one", "file", "pack", "commondir", "worktree", "above"])
def test_no_other_repository_says_what_it_has(tmp_path: Path, way: str) -> None:
    """The record would tell which names, and which contents, its commit has: whoever guesses them learns them."""
    commit = committed(tmp_path / "private")
    private, top = tmp_path / "private/.git", tmp_path / "private" / "nav"
    subprocess.run(["git", "init", "-q", str(top)], check=True)
    (top / ".git/HEAD").write_text(commit)
    objects = top / ".git/objects"
    if way == "alternates":
        (objects / "info/alternates").write_text("../../../.git/objects")
    elif way == "objects":
        subprocess.run(["rm", "-rf", str(objects)], check=True)
        objects.symlink_to(private / "objects")
    elif way == "one":
        for one in (private / "objects").iterdir():
            (objects / one.name).exists() or (objects / one.name).symlink_to(one)
    elif way == "file":
        for one in (private / "objects").glob("??/*"):
            (objects / one.parent.name).mkdir(exist_ok=True)
            (objects / one.parent.name / one.name).symlink_to(one)
    elif way == "worktree":
        own = tmp_path / "private/store/worktrees/w"
        for folder in (own, own.parents[1] / "objects", own.parents[1] / "refs"):
            folder.mkdir(parents=True, exist_ok=True)
        for name, says in {"HEAD": commit, "gitdir": str(top / ".git"), "commondir": str(private)}.items():
            (own / name).write_text(says + "\n")
        subprocess.run(["rm", "-rf", str(top / ".git")], check=True)
        (top / ".git").write_text(f"gitdir: {own}\n")
    elif way == "pack":
        subprocess.run(["git", "-C", str(tmp_path / "private"), "gc", "-q"], check=True)
        for one in (private / "objects/pack").iterdir():
            (objects / "pack" / one.name).symlink_to(one)
    elif way == "commondir":
        (top / ".git/commondir").write_text("../../.git")
    else:
        subprocess.run(["rm", "-rf", str(top / ".git/refs")], check=True)
    found = source_commit(planned(top), {"x.edf": InputFile(content=b"edf: 1\n")})
    assert found is not None and found["commit"] is None


@pytest.mark.parametrize(
    ("name", "value"), [("url", "none::x"), ("url", "::x"), ("url", "ext::touch MARK"), ("vcs", "none"), ("vcs", "")]
)
def test_a_git_that_fetches_what_is_missing_runs_no_program_for_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, value: str
) -> None:
    """GIT_NO_LAZY_FETCH is new in git 2.39.4; before, an alias took the place of the program of a made-up protocol."""
    top, mark, whole = tmp_path / "x", tmp_path / "mark", program._environment
    monkeypatch.setattr(program, "_environment", lambda *given: {**whole(*given), "GIT_NO_LAZY_FETCH": "0"})
    subprocess.run(["git", "init", "-q", str(top)], check=True)
    settings = {
        "core.repositoryFormatVersion": "1", "extensions.partialClone": "origin", "remote.origin.promisor": "true",
        "remote.origin.url": "x", f"remote.origin.{name}": value.replace("MARK", str(mark)),
        "alias.remote-none": f"!touch {mark};:", "alias.remote-": f"!touch {mark};:", "protocol.allow": "always",
    }  # fmt: skip
    for key, text in settings.items():
        subprocess.run(["git", "-C", str(top), "config", key, text], check=True)
    (top / ".git/HEAD").write_text("1" * 40)
    found = source_commit(planned(top), {})
    assert found is not None and found["commit"] is None
    assert not mark.exists(), mark


def test_a_worktree_and_a_submodule_have_their_own_commit(tmp_path: Path) -> None:
    commit = committed(tmp_path / "main")
    git = ["git", "-c", "user.name=a", "-c", "user.email=a@b", "-c", "protocol.file.allow=always", "-C"]
    main, outer, tree = tmp_path / "main", tmp_path / "outer", tmp_path / "w"
    subprocess.run(["git", "init", "-q", str(outer)], check=True)
    subprocess.run([*git, str(main), "worktree", "add", "-q", "-b", "other", str(tree)], check=True)
    subprocess.run([*git, str(outer), "submodule", "--quiet", "add", str(main), "s"], check=True)
    subprocess.run([*git, str(main), "pack-refs", "--all"], check=True)
    for folder in (tree, outer / "s", main):
        found = source_commit(planned(folder), {"x.edf": InputFile(content=b"edf: 1\n")})
        assert found is not None and (found["commit"], found["changed"], found["added"]) == (commit, [], []), folder


def test_a_repository_that_waits_for_a_pipe_is_given_up_soon(tmp_path: Path) -> None:
    committed(tmp_path / "r")
    packs = tmp_path / "r/.git/objects/pack"
    (packs / f"pack-{'a' * 40}.pack").write_bytes(b"PACK")
    os.mkfifo(packs / f"pack-{'a' * 40}.idx")
    begun = time.monotonic()
    found = source_commit(planned(tmp_path / "r"), {})
    assert found is not None and found["commit"] is None and found["problem"]
    assert time.monotonic() - begun < 8


_LOOKS = """
import resource, sys
from types import SimpleNamespace
from srprov.controller.input_commit import source_commit
experiment = SimpleNamespace(file="x.edf", folder=sys.argv[1])
print(source_commit(SimpleNamespace(definitions=SimpleNamespace(experiment=experiment)), {})["commit"])
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss >> 10)
"""


def test_a_tree_that_becomes_huge_is_not_held_in_memory(tmp_path: Path) -> None:
    """A megabyte of zeros in a clone's `.git`, packed a thousand times over, and git holds a tree as a whole."""
    committed(tmp_path / "r")
    name, size, packing = "7e" + "57" * 19, 600, zlib.compressobj(1)
    packed = [packing.compress(b"tree %d\0" % (size << 20)), *(packing.compress(bytes(1 << 20)) for _ in range(size))]
    path = tmp_path / "r/.git/objects" / name[:2] / name[2:]
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(b"".join([*packed, packing.flush()]))
    (tmp_path / "r/.git/HEAD").write_text(name + "\n")
    looked = [sys.executable, "-c", _LOOKS, str(tmp_path / "r")]
    said = subprocess.run(looked, check=True, capture_output=True, text=True, cwd=Path(__file__).parents[3]).stdout
    commit, mebibytes = said.split()
    assert (commit, int(mebibytes) < 200) == ("None", True), said
