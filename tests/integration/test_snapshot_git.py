"""Repositories that are traps, read by the real git of this machine: no program of theirs runs, nothing is written."""

from __future__ import annotations

import os
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

import pytest

from srprov import sandbox
from srprov.sandbox import sandboxed
from srprov.snapshot import gitscript
from srprov.snapshot.gitscript import Found, confined, script
from srprov.snapshot.notes import Notes
from srprov.snapshot.repositories import Repository, parse_repository
from srprov.wire import sh
from tests.traps import BAIT, START, TRAPS

ROOT = os.geteuid() == 0


def make(folder: Path, trap: str) -> Path:
    """Make a repository; return the mark that a program of it would make."""
    mark = folder / "mark"
    place = folder / "code"
    place.mkdir(parents=True)
    mark.parent.chmod(0o777)
    words, env = ["sh", "-c", f"{START}{trap}\n"], {**os.environ, "MARK": str(mark)}
    ran = subprocess.run(words, cwd=place, env=env, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    mark.unlink(missing_ok=True)
    return mark


def ask(folder: Path, *, root: bool = ROOT) -> tuple[Repository | None, list[str]]:
    """Ask as a robot's shell is asked, of root's or of the owner's; return the repository and the notes."""
    about = folder.stat()
    found = Found(folder=str(folder), uid=about.st_uid)
    login = ["setpriv", f"--reuid={about.st_uid}", f"--regid={about.st_gid}", "--clear-groups"]
    words = [*(login if ROOT and not root else []), "sh", "-c", script(found, root=root)]
    ran = subprocess.run(words, capture_output=True, text=True, check=False, cwd="/")
    notes = Notes()
    return parse_repository(found, ran.stdout, notes), [note.words for note in notes.all()]


def state(folder: Path) -> dict[str, tuple[int, int, int]]:
    """Give what would change if anybody wrote: size, time and inode of each file."""
    every = [folder, *folder.rglob("*")]
    return {str(one): (one.lstat().st_size, one.lstat().st_mtime_ns, one.lstat().st_ino) for one in every}


@pytest.fixture
def home() -> Iterator[Path]:
    """Give a folder where a user who is not root may go."""
    with tempfile.TemporaryDirectory(dir="/tmp") as folder:
        yield Path(folder)


def given_to(folder: Path, uid: int = 1000) -> None:
    """Give a folder to a user, whom only root makes another one."""
    folder.parent.chmod(0o777)
    if ROOT:
        subprocess.run(["chown", "-R", f"{uid}:{uid}", str(folder)], check=True)


@pytest.mark.parametrize("root", [True, False])
@pytest.mark.parametrize("name", sorted(TRAPS))
def test_no_program_of_a_repository_runs(name: str, home: Path, *, root: bool) -> None:
    """And what was changed is told all the same, or that it cannot be told."""
    mark = make(home, TRAPS[name])
    place = home / "code"
    if not root:
        given_to(place)
    before = state(place)
    found, notes = ask(place, root=root and ROOT)
    assert not mark.exists()
    assert state(place) == before
    if name in ("required", "promisor", "split-index", "include"):
        assert found is None or found.patch == b"", "git cannot tell, and nobody guesses"
        assert notes
    else:
        assert found is not None and b"+2" in found.patch, notes
    if name in BAIT:
        given_to(place, os.geteuid())
        subprocess.run(["sh", "-c", BAIT[name]], cwd=place, capture_output=True, check=False)
        assert mark.exists(), "it is a trap"


def test_a_program_cannot_even_be_started() -> None:
    """Whatever a version of git to come may want to run: the kernel says no."""
    for uid in (0, 1000) if ROOT else (os.geteuid(),):
        words = sh(*confined(Found(folder="/x", uid=uid), 5, root=ROOT), "sh", "-c", "(:) && echo forks")
        whole = f"o=$({words} 2>&1); printf '%s' \"$o\""
        tried = subprocess.run(["sh", "-c", whole], capture_output=True, text=True, check=False)
        assert "fork" in tried.stdout and "forks" not in tried.stdout, tried


@pytest.mark.skipif(not ROOT, reason="only root could read what others may not")
def test_no_file_of_others_is_told(tmp_path: Path) -> None:
    """By another worktree, by a link of a folder, or by objects that are borrowed."""
    secret = tmp_path / "root" / "a"
    secret.parent.mkdir(mode=0o700)
    secret.write_text("of root alone\n", encoding="utf-8")
    traps = {
        "worktree": f"git config core.worktree {secret.parent}",
        "folder": f"mkdir d && cp a d/a && git add d && git commit -qm 2 && rm -r d && ln -s {secret.parent} d"
        " && git update-ref refs/remotes/origin/main HEAD",
        "alternates": f"echo {secret.parent} >.git/objects/info/alternates",
        "link": f"rm a && ln -s {secret} a",
    }
    tmp_path.chmod(0o755)
    for name, trap in traps.items():
        place = tmp_path / name
        make(place, trap)
        subprocess.run(["chown", "-R", "1000:1000", str(place)], check=True)
        found, notes = ask(place / "code")
        assert b"of root alone" not in (found.patch if found else b""), name
        assert "of root alone" not in str(notes), name


@pytest.mark.parametrize("root", [True, False])
def test_what_git_follows_leads_nowhere_else(home: Path, *, root: bool) -> None:
    """Whatever names the objects of another repository of the owner's, by links, lists or settings to come."""
    make(home, "git checkout -q -b private && echo hidden >a && git commit -qam 2")
    (home / "code").rename(home / "private")
    make(home, "true")
    private, git = home / "private" / ".git", home / "code" / ".git"
    hidden = (private / "refs" / "heads" / "private").read_text()
    (git / "refs" / "heads" / "main").write_text(hidden)
    (git / "refs" / "remotes" / "origin" / "main").write_text(hidden)
    (git / "objects" / "info" / "alternates").write_text(f"{private}/objects\n", encoding="utf-8")
    tried = subprocess.run(["git", "diff", "HEAD"], cwd=home / "code", capture_output=True, text=True, check=True)
    assert "-hidden" in tried.stdout, "it is a trap"
    given_to(home / "private")
    given_to(home / "code")
    assert ask(home / "code", root=root and ROOT) == (None, ["borrows objects from another folder: it is not read"])
    of_one = gitscript._script
    passed = mock.Mock(side_effect=lambda *one, **how: of_one(*one, **how).replace("info/alternates", "info/others"))
    with mock.patch.object(gitscript, "_script", passed):  # as if nobody knew of that way
        found, notes = ask(home / "code", root=root and ROOT)
    told = f"its commit {hidden[:12]} is on no remote that it knows of: push it and look again"
    assert (found, notes) == (None, [told]), "it is not there"


def test_what_cannot_be_closed_off_is_named(tmp_path: Path) -> None:
    make(tmp_path, "true")
    with mock.patch.object(sandbox, "_ENTER", f"exit {sandbox.NO_SANDBOX}"):
        found, (note,) = ask(tmp_path / "code")
    assert found is None and "cannot be closed off from the robot's other files" in note


@pytest.mark.skipif(not ROOT, reason="only root could read what others may not")
def test_no_repository_of_others_is_read_by_links(tmp_path: Path) -> None:
    """Root in a container makes links in the place of git's folders: what only root may read was in a patch."""
    make(tmp_path / "private", "true")
    private = tmp_path / "private" / "code" / ".git"
    private.parent.parent.chmod(0o700)
    place = tmp_path / "data" / "r"
    git = place / ".git"
    (git / "refs" / "remotes").mkdir(parents=True)
    (git / "objects").symlink_to(private / "objects")
    for refs in ("heads", "remotes/origin"):
        (git / "refs" / refs).symlink_to(private / "refs" / "heads")
    (git / "HEAD").write_text((private / "HEAD").read_text())
    (git / "config").write_text('[remote "origin"]\n\turl = https://git.example/x.git\n')
    for root in (True, False):
        assert ask(place, root=root) == (None, ["has links among git's files: it is not read"])
    # one that comes after that look leads nowhere
    with mock.patch.object(gitscript, "_LINKS", "-type l -false -print -quit"):
        assert ask(place) == (None, ["has no commit, or cannot be read by its owner with plain git"])


@pytest.mark.skipif(not ROOT, reason="only root closes a folder off")
def test_a_link_leads_to_no_repository_beside_the_robots_programs(tmp_path: Path) -> None:
    words = sandboxed(str(tmp_path), "ls -A /usr/local /usr/src | grep -v : | tr -d '\\n'; ls /usr/bin/git")
    ran = subprocess.run(["sh", "-c", words], capture_output=True, text=True, check=False)
    assert ran.stdout == "/usr/bin/git\n", ran


@pytest.mark.skipif(not ROOT, reason="only root reads what others may not")
def test_a_repository_of_roots_whose_files_take_too_long_to_look_at_is_not_read(tmp_path: Path) -> None:
    """Millions of files beside one of another user's had root read for him."""
    make(tmp_path, "true")
    assert ask(tmp_path / "code", root=True)[0] is not None
    with mock.patch.object(gitscript, "_OTHERS", "-exec sleep 9 ';'"), mock.patch.object(gitscript, "_LONG_S", 1):
        found, (note,) = ask(tmp_path / "code", root=True)
    assert found is None and "too many files to know whether others have some of them" in note


@pytest.mark.parametrize("where", ["config", "config.worktree"])
@pytest.mark.parametrize("root", [True, False])
def test_no_repository_s_settings_include_other_files(tmp_path: Path, where: str, *, root: bool) -> None:
    """What git says then tells of a file that only the user who reads may read."""
    include = f"printf '[core] [InClude]\\npath = /x\\n' >>.git/{where}"
    make(tmp_path, f"git config extensions.worktreeConfig true; {include}")
    found, notes = ask(tmp_path / "code", root=root and ROOT)
    assert (found, notes) == (None, ["has settings that include other files: it is not read"])


def test_what_cannot_be_read_is_named(tmp_path: Path) -> None:
    """Pipes where files should be do not keep anybody waiting."""
    make(tmp_path / "pipe", "rm .git/index && mkfifo .git/index")
    assert ask(tmp_path / "pipe/code") == (None, ["has no files where git has them: it is not read"])
    make(tmp_path / "head", "rm .git/HEAD && mkfifo .git/HEAD")
    assert ask(tmp_path / "head/code")[0] is None
    make(tmp_path / "file", "rm a && mkfifo a")
    found, notes = ask(tmp_path / "file/code")
    assert (found is not None and b"deleted file" in found.patch) or notes
    make(tmp_path / "empty", "rm -rf .git && git init -q .")
    assert ask(tmp_path / "empty/code") == (None, ["has no commit, or cannot be read by its owner with plain git"])
    make(tmp_path / "moved", "mv .git .elsewhere && ln -s .elsewhere .git")
    assert ask(tmp_path / "moved/code")[0] is None
    make(tmp_path / "ext", "git remote set-url origin 'ext::sh -c reboot'")
    assert ask(tmp_path / "ext/code")[1] == ["its remote is of a kind that is not fetched from (ext::)"]
    make(tmp_path / "login", "git remote set-url origin https://robot:hunter2@h.example/code.git")
    found, notes = ask(tmp_path / "login/code")
    assert found is not None and found.url == "https://h.example/code.git" and "hunter2" not in str(notes)
    make(tmp_path / "local", "echo 3 >a && git commit -qam 3")
    assert "is on no remote" in ask(tmp_path / "local/code")[1][0]


def test_files_with_odd_names_and_large_changes(tmp_path: Path) -> None:
    """A patch is as long as it may be, or there is none; a name's line break stays in the name."""
    make(tmp_path / "names", "printf x >'new\nline' && git add . && printf y >'new\nline' && printf '\\377\\n' >a")
    found, notes = ask(tmp_path / "names/code")
    assert found is not None and b'"b/new\\nline"' in found.patch and b"+\xff\n" in found.patch, notes
    make(tmp_path / "large", "seq 1 200000 >a")
    found, notes = ask(tmp_path / "large/code")
    assert found is not None and found.patch == b"" and "more than 384 KiB" in notes[-1], notes
    make(tmp_path / "binary", "head -c 100 /dev/zero >a")
    found, notes = ask(tmp_path / "binary/code")
    assert found is not None and found.patch == b"" and "is no text" in notes[-1]
    make(tmp_path / "touched", "printf '1\\n' >a && touch -d '2001-01-01' a b")
    found, notes = ask(tmp_path / "touched/code")
    assert found is not None and found.patch == b"" and notes == []
    make(tmp_path / "secret", "printf 'password = hunter2-x\\n' >b")
    found, notes = ask(tmp_path / "secret/code")
    assert found is not None and b"a/a" in found.patch and b"hunter2" not in found.patch and "b/b" in notes[-1]
