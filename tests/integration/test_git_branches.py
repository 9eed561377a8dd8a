"""A lock may come from a stranger: its commits are those of the names that it has them for, or the plan says so."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.controller.repositories import Repositories, commit_of
from srprov.controller.source import read_definitions
from srprov.definitions.lockfile import Lock, dump
from srprov.git import branches, cache, program
from srprov.git.program import GitError
from tests.integration.test_git import Server

_ELSEWHERE = "which does not lead there: the name was moved or rewritten since, or somebody else put that commit there"


@pytest.fixture
def server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Server:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return Server(tmp_path / "server")


def request(server: Server) -> str:
    """Return a commit that anybody may have put there: as hosts of repositories keep pull requests."""
    server.git("checkout", "-q", "--detach")
    made = server.commit(a="evil")
    server.git("update-ref", "refs/pull/1/head", made)
    server.git("checkout", "-q", "main")
    return made


def doubt(server: Server, ref: str, commit: str) -> str:
    return branches.doubt(server.address, ref, commit)


@pytest.mark.parametrize("protocol", ["2", "0"])
def test_a_commit_of_a_pull_request_is_none_of_a_branch(
    server: Server, protocol: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(program, "_SETTINGS", (*program._SETTINGS, f"protocol.version={protocol}"))
    server.git("config", "uploadpack.allowFilter", "true")
    old = server.commit(a="1")
    server.git("tag", "-am", "x", "v1")
    new = server.commit(a="2")
    evil = request(server)
    for ref in ("main", "", "v1"):
        assert _ELSEWHERE in doubt(server, ref, evil) and _ELSEWHERE in doubt(server, ref, "1" * 40)
    assert [doubt(server, "main", one) for one in (old, new)] == ["", ""] == [doubt(server, "", new), ""]
    assert doubt(server, "v1", old) == "" and _ELSEWHERE in doubt(server, "v1", new), "a tag leads to nothing newer"
    server.git("branch", "-f", "other", new)
    later = server.commit(a="3")
    assert doubt(server, "main", later) == "" and _ELSEWHERE in doubt(server, "other", later)
    assert f"the lock has commit {evil[:12]} for the default branch of file://" in doubt(server, "", evil)


def test_what_is_known_needs_no_repository_any_more(server: Server, tmp_path: Path) -> None:
    """Nor the branch: who locks an experiment runs it as it was, also when the branch is another one by then."""
    old = server.commit(a="1")
    server.commit(a="2")
    assert doubt(server, "main", old) == ""
    server.git("branch", "feature", evil := request(server))
    assert commit_of(server.address.url, "feature") == evil and doubt(server, "feature", evil) == ""
    server.git("branch", "-D", "feature")
    assert doubt(server, "feature", evil) == "" != doubt(server, "main", evil)
    server.folder.rename(tmp_path / "gone")
    assert doubt(server, "main", old) == "" == doubt(server, "feature", evil)
    assert "whether that leads there cannot be found out: " in doubt(server, "main", evil)
    (known,) = (tmp_path / "cache").rglob("*.led")
    known.chmod(0o777)
    assert "cannot be found out" in doubt(server, "main", old), "what others may have put there says nothing"


def test_no_files_are_fetched_to_find_it_out(server: Server, tmp_path: Path) -> None:
    server.git("config", "uploadpack.allowFilter", "true")
    old = server.commit(a="1")
    server.commit(a="2")
    assert doubt(server, "main", old) == ""
    (history,) = (tmp_path / "cache").rglob("*.history")
    with pytest.raises(GitError):
        program.run([f"--git-dir={history}", "cat-file", "-e", f"{old}:a"], most=10, seconds=10)
    assert cache.files(server.address, old, 100)[0].content == b"1"


def test_the_plan_says_so_of_a_stranger_s_lock(server: Server, tmp_path: Path) -> None:
    """Of code that goes into an image, and of a CDF: its branch stands in the EDF, and somebody else's commit ran."""
    good = server.commit(a="1", **{"a.cdf": "cdf: 1\nname: a\nbase: busybox\n"})
    evil, url = request(server), server.address.url
    edf = tmp_path / "e.edf"
    edf.write_text(
        f"edf: 1\nname: e\nservices:\n  a: {{cdf: {{git: '{url}', ref: main, path: a.cdf}}}}\n  b: {{cdf: b.cdf}}\n"
    )
    (tmp_path / "b.cdf").write_text(
        f"cdf: 1\nname: b\nbase: busybox\nrepositories: [{{git: '{url}', ref: main, path: /r}}]\n"
    )
    for commit, told in ((good, 0), (evil, 1)):
        (tmp_path / "e.lock").write_text(dump(Lock(commits={(url, "main"): commit}, version="1")))
        found = read_definitions(str(edf), {"git", "outside"})
        assert sum(_ELSEWHERE in note for note in found.notes) == told
        (cdf,) = (one for one in found.containers.values() if one.repositories)
        moving = Repositories([cdf]).checkout(cdf, 0).moving
        assert (_ELSEWHERE in moving) == bool(told) and bool(moving) == bool(told)


def test_where_there_is_no_network_each_commit_is_asked_for_once(
    server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Many CDFs may have one repository, and to find out that nobody answers takes up to a minute."""
    commit, url = server.commit(a="1"), server.address.url
    cache.files(server.address, commit, 100)
    server.folder.rename(tmp_path / "gone")
    (tmp_path / "e.edf").write_text("edf: 1\nname: e\nservices: {a: {cdf: a.cdf}, b: {cdf: b.cdf}}\n")
    for name in "ab":
        code = f"[{{git: '{url}', ref: main, path: /r}}]"
        (tmp_path / f"{name}.cdf").write_text(f"cdf: 1\nname: {name}\nbase: busybox\nrepositories: {code}\n")
    (tmp_path / "e.lock").write_text(dump(Lock(commits={(url, "main"): commit}, version="1")))
    found, asked = read_definitions(str(tmp_path / "e.edf"), {"git", "outside"}), []
    monkeypatch.setattr(branches, "resolve", lambda *one: asked.append(one) or cache.resolve(*one))
    fetched = Repositories(found.containers.values())
    told = {fetched.checkout(cdf, 0).moving for cdf in found.containers.values()}
    assert len(asked) == 1 and "cannot be found out" in told.pop() and not told
