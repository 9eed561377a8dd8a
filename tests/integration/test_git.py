"""Repositories of others, with the real git: what is taken is what the commit holds, and nothing of theirs runs."""

from __future__ import annotations

import os
import subprocess
import time
from pathlib import Path

import pytest

from srprov.git import cache, program
from srprov.git.program import GitError
from srprov.git_address import Address, parse_address

MOST = 1 << 20


class Server:
    """A repository on this machine, and the ways to fill it that a stranger has."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.git("init", "-q", "-b", "main")

    @property
    def address(self) -> Address:
        return parse_address(f"file://{self.folder}")

    def git(self, *words: str, given: bytes = b"") -> str:
        self.folder.mkdir(exist_ok=True)
        settings = ("-c", "user.name=a", "-c", "user.email=a@b.c", "-c", "commit.gpgsign=false")
        run = ["git", *settings, *words]
        return (
            subprocess.run(run, cwd=self.folder, input=given, capture_output=True, check=True).stdout.decode().strip()
        )

    def commit(self, **files: str) -> str:
        for name, content in files.items():
            (self.folder / name).write_text(content)
        self.git("add", "-A")
        self.git("commit", "-qm", "x", "--allow-empty")
        return self.git("rev-parse", "HEAD")

    def tree(self, *lines: str) -> str:
        """Commit a tree of `mode type object TAB name` lines, whatever they say."""
        made = self.git("mktree", "--missing", given="".join(f"{line}\n" for line in lines).encode())
        self.git("update-ref", "refs/heads/main", commit := self.git("commit-tree", made, "-m", "x"))
        return commit

    def blob(self, content: str) -> str:
        return self.git("hash-object", "-w", "--stdin", given=content.encode())


@pytest.fixture
def server(tmp_path: Path) -> Server:
    return Server(tmp_path / "server")


def _files(server: Server, commit: str, tmp_path: Path, **more: object) -> dict[str, tuple[bytes, bool, bool]]:
    found = cache.files(server.address, commit, MOST, folder=tmp_path / "cache", **more)  # type: ignore[arg-type]
    return {one.path: (one.content, one.executable, one.is_link) for one in found}


def test_names_are_looked_up(server: Server) -> None:
    first = server.commit(a="1")
    server.git("tag", "-am", "x", "v1")
    second = server.commit(a="2")
    server.git("branch", "feature/x", first)
    names = {ref: cache.resolve(server.address, ref) for ref in ("", "main", "v1", "feature/x", "refs/tags/v1", first)}
    assert names == {"": second, "main": second, "v1": first, "feature/x": first, "refs/tags/v1": first, first: first}
    server.git("tag", "main", first)
    with pytest.raises(GitError, match="'main' is a branch and a tag"):
        cache.resolve(server.address, "main")
    for ref in ("nothing", first[:8], "mai"):
        with pytest.raises(GitError, match=f"no branch or tag '{ref}'"):
            cache.resolve(server.address, ref)
    with pytest.raises(GitError, match="does not appear to be a git repository"):
        cache.resolve(parse_address(f"file://{server.folder}x"), "main")


def test_files_are_those_of_the_commit_whatever_attributes_say(server: Server, tmp_path: Path) -> None:
    (server.folder / "sub").mkdir()
    (server.folder / "run.sh").write_text("#!/bin/sh\n")
    (server.folder / "run.sh").chmod(0o755)
    (server.folder / "sub" / "link").symlink_to("../a")
    attributes = "* text eol=crlf ident export-subst\nhidden export-ignore\na filter=evil\n"
    commit = server.commit(a="$Id$ $Format:%H$\n", hidden="x", **{".gitattributes": attributes})
    assert _files(server, commit, tmp_path) == {
        ".gitattributes": (attributes.encode(), False, False),
        "a": (b"$Id$ $Format:%H$\n", False, False),
        "hidden": (b"x", False, False),
        "run.sh": (b"#!/bin/sh\n", True, False),
        "sub/link": (b"../a", False, True),
    }


def test_a_commit_that_is_there_needs_no_repository_any_more(server: Server, tmp_path: Path) -> None:
    commit = server.commit(a="1")
    first = _files(server, commit, tmp_path)
    server.folder.rename(tmp_path / "gone")
    assert _files(server, commit, tmp_path) == first
    with pytest.raises(GitError):
        _files(server, "1" * 40, tmp_path)
    folder = tmp_path / "cache"
    assert folder.stat().st_mode & 0o077 == 0


def test_a_commit_behind_the_branch_is_fetched_from_a_server_that_gives_only_branches(
    server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    old = server.commit(a="1")
    server.commit(a="2")
    monkeypatch.setattr(program, "_SETTINGS", (*program._SETTINGS, "protocol.version=0"))
    assert _files(server, old, tmp_path)["a"][0] == b"1"


@pytest.mark.parametrize(
    ("target", "stays"),
    [("a", True), ("./sub/../a", True), ("/etc/passwd", False), ("../a", False), ("sub/../../a", False),
     ("link", False), ("deep/../..", False), ("deep/x", True), ("", False)],
)  # fmt: skip
def test_links_stay_in_the_repository(server: Server, tmp_path: Path, target: str, stays: bool) -> None:
    """`deep` leads to a folder above, so that what looks as if it stays does not."""
    x = server.blob("x")
    inner = server.git("mktree", given=f"100644 blob {x}\tf\n".encode())
    lines = [f"100644 blob {x}\ta", f"120000 blob {server.blob('.')}\tdeep", f"120000 blob {server.blob(target)}\tlink",
             f"040000 tree {inner}\tsub"]  # fmt: skip
    commit = server.tree(*lines)
    if stays:
        assert _files(server, commit, tmp_path)["link"][2]
    else:
        with pytest.raises(GitError, match=r"link link leads out|no folder can have"):
            _files(server, commit, tmp_path)


def test_what_no_folder_can_have_is_refused(server: Server, tmp_path: Path) -> None:
    x = server.blob("x")
    inner = server.git("mktree", given=f"100644 blob {x}\tf\n".encode())
    for lines, why in (
        ([f"160000 commit {'1' * 40}\tlib"], "submodule lib"),
        ([f"100644 blob {x}\ta", f"100644 blob {x}\ta"], "name twice"),
        ([f"120000 blob {x}\ta", f"040000 tree {inner}\ta"], "no folder"),
        ([f"040000 tree {inner}\t.GIT"], "no folder can have"),
        ([f'100644 blob {x}\t"a\\nb"'], "no folder can have"),
        ([f'100644 blob {x}\t"\\377"'], "not UTF-8"),
        ([f"040000 tree {inner}\t.."], "no folder can have|bad tree|malformed|\\.\\."),
        ([], "no file"),
    ):
        commit = server.tree(*lines)
        with pytest.raises(GitError, match=why):
            _files(server, commit, tmp_path)
    commit = server.tree(f"100644 blob {x}\ta", f"160000 commit {'1' * 40}\tlib")
    assert list(_files(server, commit, tmp_path, elsewhere={"lib"})) == ["a"]


def test_a_folder_with_a_commit_is_no_repository(
    server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A record has copies of it, and git runs what the settings of a repository name, also of one without `.git`."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    x = server.blob("x")
    inner = server.git("mktree", given=f"100644 blob {x}\tx\n".encode())
    bare = [f"100644 blob {x}\tHEAD", f"100644 blob {x}\tconfig"]
    bare += [f"040000 tree {inner}\tobjects", f"040000 tree {inner}\trefs"]
    src = server.git("mktree", given="".join(f"{line}\n" for line in bare).encode())
    with pytest.raises(GitError, match="src/HEAD: a repository here could name programs"):
        cache.folder(server.address, server.tree(f"040000 tree {src}\tsrc"), MOST)
    made = cache.folder(server.address, server.tree(*bare[:3], f"040000 tree {inner}\t.hg"), MOST)
    assert sorted(one.name for one in made.iterdir()) == ["HEAD", "config", "objects"]


def test_sizes_are_known_before_anything_is_read(server: Server, tmp_path: Path) -> None:
    commit = server.commit(a="x" * (MOST + 1))
    with pytest.raises(GitError, match="more than 20000 files or 1 MiB"):
        _files(server, commit, tmp_path)
    tree = server.git("mktree", given=f"100644 blob {server.blob('x')}\tf\n".encode())
    for _ in range(9):  # ten to the ninth files in ten objects
        tree = server.git("mktree", given="".join(f"040000 tree {tree}\td{i}\n" for i in range(10)).encode())
    bomb = server.git("commit-tree", tree, "-m", "x")
    server.git("update-ref", "refs/heads/main", bomb)
    begin = time.monotonic()
    with pytest.raises(GitError, match="prints more than"):
        _files(server, bomb, tmp_path)
    assert time.monotonic() - begin < 10


def test_what_is_fetched_has_a_size_and_a_time(server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    commit = server.commit(a=os.urandom(300_000).hex())
    monkeypatch.setattr(program, "MOST_FETCHED", 100 * 1024)
    with pytest.raises(GitError, match="larger than 0 MiB"):
        _files(server, commit, tmp_path)
    monkeypatch.undo()
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    (tmp_path / "git").write_text("#!/bin/sh\nsleep 60\n")
    (tmp_path / "git").chmod(0o755)
    begin = time.monotonic()
    with pytest.raises(GitError, match=r"not done after 0\.3 s"):
        program.run(["x"], most=1, seconds=0.3)
    assert time.monotonic() - begin < 40


def test_nothing_of_the_users_settings_or_of_a_repository_runs(
    server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Hooks, filters, helpers and replaced addresses, in the user's own configuration and in the repository's."""
    ran = tmp_path / "ran"
    evil = tmp_path / "evil"
    evil.write_text(f"#!/bin/sh\necho $0 $* >> {ran}\nexit 1\n")
    evil.chmod(0o755)
    commit = server.commit(a="1", **{".gitattributes": "a filter=evil diff=evil\n"})
    hooks = server.folder / ".git" / "hooks"
    for hook in ("post-checkout", "pre-receive", "reference-transaction", "post-index-change"):
        (hooks / hook).write_text(evil.read_text())
        (hooks / hook).chmod(0o755)
    config = f"""[core]
  fsmonitor = {evil}
  hooksPath = {hooks}
  alternateRefsCommand = {evil}
  sshCommand = {evil}
  gitProxy = {evil}
[filter "evil"]
  smudge = {evil}
  clean = {evil}
[credential]
  helper = {evil}
[uploadpack]
  packObjectsHook = {evil}
[url "ext::{evil}"]
  insteadOf = file://
"""
    with (server.folder / ".git" / "config").open("a") as file:
        file.write(config)
    home = tmp_path / "home"
    home.mkdir()
    (home / ".gitconfig").write_text(config)
    monkeypatch.setenv("HOME", str(home))
    for name in ("GIT_SSH", "GIT_ASKPASS", "GIT_PROXY_COMMAND", "GIT_EXTERNAL_DIFF", "GIT_TEMPLATE_DIR"):
        monkeypatch.setenv(name, str(evil))
    assert cache.resolve(server.address, "main") == commit
    assert _files(server, commit, tmp_path)["a"][0] == b"1"
    assert not ran.exists(), ran.read_text()


def test_git_reaches_a_repository_by_the_one_way_that_its_address_says(server: Server) -> None:
    server.commit(a="1")
    for address, transport in (
        (server.address.url, "https"),
        ("ext::sh -c false", "file"),
        (server.address.url, "none"),
    ):
        with pytest.raises(GitError, match=r"transport '.*' not allowed"):
            program.run(["ls-remote", "--", address], transport=transport, most=1000, seconds=10)
