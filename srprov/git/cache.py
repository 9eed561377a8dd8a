"""Bare repositories that were fetched, one per address, below the user's cache folder.

Takes addresses, names and commits; gives commits and files. The network is asked for a name that may have moved, and
for a commit that is not there yet. Nothing is checked out: files are read as they are in the commit.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
import shutil
import tempfile
import time
from collections.abc import Collection, Iterator
from pathlib import Path

from srprov import believed, private
from srprov.definitions.repository_names import WHY, is_kept_name, repository_among
from srprov.git.program import FETCH_S, LOOK_S, GitError, run
from srprov.git.tree import MOST_FILES, Entry, TreeFile, check_links, entries
from srprov.git_address import Address, is_commit

_MOST_NAMES = 1 << 20
_MOST_LISTED = MOST_FILES * 400
ALL = ("+refs/heads/*:refs/srprov/heads/*", "+refs/tags/*:refs/srprov/tags/*")


def default_folder() -> Path:
    """Return where repositories are kept: `$XDG_CACHE_HOME/srprov/git`."""
    return private.cache_folder() / "git"


def folders() -> Path:
    """Return where folders with the files of commits are."""
    return default_folder() / "folders"


def place_of(address: Address, folder: Path | None = None) -> Path:
    """Return where something of a repository is kept, without a suffix."""
    return (folder or default_folder()) / hashlib.sha256(address.url.encode()).hexdigest()[:32]


def resolve(address: Address, ref: str) -> str:
    """Return the commit that a branch or tag is now; an empty name is the default branch.

    Raises:
        GitError: There is none, or the repository cannot be reached.
    """
    if is_commit(ref):
        return ref
    full = ref.startswith("refs/")
    names = [ref or "HEAD"] if full or not ref else [f"refs/tags/{ref}", f"refs/heads/{ref}"]
    commits = _commits(address, names)
    if len(commits) > 1:
        raise GitError(f"'{ref}' is a branch and a tag: write refs/heads/{ref} or refs/tags/{ref}")
    if not commits or not is_commit(next(iter(commits))):
        short = " (a commit is named by all of its digits)" if ref and set(ref) <= set("0123456789abcdef") else ""
        raise GitError(f"it has no branch or tag '{ref}'{short}" if ref else "it has no default branch")
    return commits.pop()


def _commits(address: Address, names: Collection[str]) -> set[str]:
    """Return what these names are in a repository, as far as it has them; of a tag, the commit that it names."""
    asked = [*names, *(f"{name}^{{}}" for name in names)]
    arguments = ["ls-remote", "--quiet", "--", address.url, *asked]
    printed = run(arguments, transport=address.scheme, most=_MOST_NAMES, seconds=LOOK_S).decode("utf-8", "replace")
    found = {name: commit for commit, _, name in (line.partition("\t") for line in printed.splitlines())}
    return {found.get(f"{name}^{{}}") or found[name] for name in names if name in found}


def files(
    address: Address, commit: str, most: int, *, elsewhere: Collection[str] = (), folder: Path | None = None
) -> tuple[TreeFile, ...]:
    """Return what a commit holds, sorted by path; it is fetched if it is not there yet.

    Args:
        address: The repository.
        commit: In full.
        most: Bytes that all files may have together.
        elsewhere: Paths of submodules that are repositories of their own.
        folder: Where repositories are kept; None: `default_folder()`.

    Raises:
        GitError: It cannot be fetched, or holds what cannot be taken.
        OSError: It cannot be kept.
    """
    place = place_of(address, folder).with_suffix(".git")
    with locked(place):
        if not _has(place, commit):
            _fetch(place, address, commit)
    listing = ["ls-tree", "-r", "-z", "-l", "--full-tree", commit]
    found = entries(run(listing, repository=place, most=_MOST_LISTED, seconds=LOOK_S), most, elsewhere)
    contents = _contents(place, found)
    check_links({one.path: contents[one.object] for one in found if one.is_link})
    return tuple(
        TreeFile(one.path, contents[one.object], one.executable, one.is_link)
        for one in sorted(found, key=lambda one: one.path)
    )


def folder(address: Address, commit: str, most: int) -> Path:
    """Return a folder of this user's with the files of a commit; it is made if it is not there yet.

    Records have copies of it. So what version control calls its own is left out, as it is of what is shipped, and no
    folder of it is a repository.

    Raises:
        GitError: It cannot be fetched, or holds what cannot be taken.
        OSError: It cannot be kept.
    """
    place = folders() / hashlib.sha256(f"{address.url} {commit}".encode()).hexdigest()[:32]
    if os.path.lexists(place):
        believed.check(place)
        return place
    found = [one for one in files(address, commit, most) if not is_kept_name(one.path)]
    if strange := repository_among(one.path for one in found):
        raise GitError(f"it holds {strange[:200]}: {WHY}")
    believed.make_folder(place.parent)
    draft = Path(tempfile.mkdtemp(dir=place.parent))
    try:
        for one in found:
            path = draft / one.path
            path.parent.mkdir(parents=True, exist_ok=True)
            if one.is_link:
                path.symlink_to(one.content.decode("utf-8"))
            else:
                path.write_bytes(one.content)
                path.chmod(0o700 if one.executable else 0o600)
        draft.rename(place)
    except OSError:
        if not place.is_dir():  # somebody else was faster
            raise
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    return place


@contextlib.contextmanager
def locked(place: Path) -> Iterator[None]:
    """Let one process at a time fetch into a repository."""
    believed.make_folder(place.parent)
    if os.path.lexists(place):
        believed.check(place)  # git runs what the settings of a repository name
    end = time.monotonic() + FETCH_S
    guard = os.open(place.with_suffix(".lock"), os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        while True:
            try:
                fcntl.flock(guard, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if time.monotonic() > end:
                    raise GitError(f"another process fetches it since {FETCH_S:g} s") from None
                time.sleep(0.1)
        yield
    finally:
        os.close(guard)


def _has(place: Path, commit: str) -> bool:
    if not place.is_dir():
        return False
    try:
        run(["cat-file", "-e", f"{commit}^{{tree}}"], repository=place, most=0, seconds=LOOK_S)
    except GitError:
        return False
    return True


def make(place: Path, commit: str) -> None:
    """Make a bare repository for commits of this kind; one that is there stays.

    Raises:
        GitError: It cannot be made.
    """
    kind = "sha256" if len(commit) == 64 else "sha1"
    made = ["init", "--quiet", "--bare", "--template=", f"--object-format={kind}", "--", str(place)]
    run(made, most=_MOST_NAMES, seconds=LOOK_S)


def _fetch(place: Path, address: Address, commit: str) -> None:
    make(place, commit)
    fetch = ["fetch", "--quiet", "--no-tags", "--no-write-fetch-head"]
    for more in (
        ["--depth=1", "--", address.url, commit],
        ["--", address.url, *ALL],
    ):  # not every server gives a commit by its id
        try:
            run([*fetch, *more], repository=place, transport=address.scheme, most=_MOST_NAMES, seconds=FETCH_S)
        except GitError as error:
            why = error
        else:
            if _has(place, commit):
                return
            why = GitError(f"it has no commit {commit}")
    raise why


def _contents(place: Path, found: list[Entry]) -> dict[str, bytes]:
    """Return object -> content; the sizes were checked before."""
    sizes = {one.object: one.size for one in found}
    whole = sum(len(f"{name} blob {size}\n") + size + 1 for name, size in sizes.items())
    with tempfile.TemporaryFile() as asked:
        asked.write("".join(f"{name}\n" for name in sizes).encode())
        asked.seek(0)
        batch = ["cat-file", "--batch"]
        printed = memoryview(run(batch, repository=place, most=whole, seconds=FETCH_S, given=asked))
    contents, at = {}, 0  # type: dict[str, bytes], int
    for name, size in sizes.items():
        begin = f"{name} blob {size}\n".encode()
        if printed[at : at + len(begin)] != begin:
            raise GitError(f"the object {name} is missing in {place}; remove that folder")
        at += len(begin)
        contents[name] = bytes(printed[at : at + size])
        at += size + 1
    return contents
