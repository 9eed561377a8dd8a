"""The commit that a checkout stands on, as its own folder says it.

Takes a folder; gives the checkout's top folder, its repository and the commit. Reads files, runs nothing. A `.git` may
come with a stranger's project: git would follow its links, and its settings, to any file of this machine, and repeat
what that holds. So HEAD and what it names are read here, by paths without links and of files with one name, and nothing
but a commit is taken from them. A checkout that has objects of another repository's has none.

Where git is asked of that commit, it is asked of the folders that were looked at here: what it would find by itself,
by its own rules, may be another repository.
"""

from __future__ import annotations

import itertools
import os
import re
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from srprov import regular_file
from srprov.git_address import is_commit

_MOST = 64 * 1024
"""Bytes of a reference, and of a checkout's settings."""
_MOST_PACKED = 32 << 20
"""Bytes of all references in one file: some 400,000."""
_MOST_FOLDERS = 1000
"""And files, in a folder of objects; git makes 258."""
_MOST_OBJECTS = 200_000
"""Files that are looked at there; git packs them when there are some 7000."""
_LONGEST_COMMIT = 64
_MOST_STEPS = 5
"""From one reference to the next; source: git's own limit."""
_REFERENCE = re.compile(r"refs(/(?!\.)[^/\x00-\x20\x7f]+)+")


class Checkout(NamedTuple):
    """A checkout whose repository holds nothing but its own."""

    top: str
    objects: str
    """Their folder; of a worktree, that of the repository that it belongs to."""
    commit: str


def checkout_of(folder: str) -> Checkout | None:
    """Return the checkout that a folder lies in; None where its commit cannot be told."""
    here = Path(os.path.realpath(folder))
    top = next((one for one in (here, *here.parents) if os.path.lexists(one / ".git")), None)
    own = _own_folder(top) if top else None
    if top is None or own is None or not _is_mine(top, top / ".git", own):
        return None
    # a worktree has a HEAD of its own, and the references of the repository that it belongs to
    shared = own
    if own != top / ".git" and own.parent.name == "worktrees":
        shared = own.parents[1]
        if not (common := _line(own / "commondir")) or os.path.normpath(own / common) != str(shared):
            return None  # git goes by what stands there
    if _borrows(shared):
        return None
    found = _line(own / "HEAD")
    for _ in range(_MOST_STEPS):
        if is_commit(found):
            return Checkout(str(top), str(shared / "objects"), found)
        word, _, name = found.partition(" ")
        if word != "ref:" or not _REFERENCE.fullmatch(name.strip()):
            return None
        found = _line(shared / name.strip()) or _packed(shared, name.strip())
    return None


def _own_folder(top: Path) -> Path | None:
    """Return where a checkout's HEAD lies: its `.git`, or the folder that this names and that names it in return.

    Git writes both names into worktrees and submodules. Without the second one any repository could be named. Names
    are taken as texts: where a link of the user's leads must not show in what is found.
    """
    git = top / ".git"
    if _is_folder(git):
        return git
    word, _, named = _line(git).partition(" ")
    own = Path(os.path.normpath(top / named))
    if word != "gitdir:" or not named:
        return None
    says = _worktree(_text(own / "config"))
    claimed = [own / _line(own / "gitdir"), *([own / says / ".git"] if says else [])]
    return own if str(git) in map(os.path.normpath, claimed) else None


def _worktree(config: str) -> str:
    """Return the first folder that a repository's settings name as its worktree, or nothing."""
    pairs = (line.partition("=") for line in config.split("\n"))
    return next(filter(None, (value.strip(" \t") for key, _, value in pairs if key.strip(" \t") == "worktree")), "")


def _is_mine(*paths: Path) -> bool:
    """Return whether all of this is the user's: git asks that of a repository that it finds, not of one it is given."""
    try:
        return all(os.lstat(one).st_uid == os.geteuid() for one in paths)
    except OSError:
        return False


def _borrows(shared: Path) -> bool:
    """Return whether git would look for objects in another repository: whoever wrote this one could ask what that has.

    So it would where the folder is none to git, which goes on in those above.
    """
    objects = shared / "objects"
    if not (_is_folder(objects) and _is_folder(shared / "refs")):
        return True
    named = (shared / "commondir", objects / "info/alternates", objects / "info/http-alternates")
    if any(map(os.path.lexists, named)):
        return True
    try:
        return _has_links(os.fspath(objects))
    except OSError:
        return True


def _is_folder(path: Path) -> bool:
    """Return whether a folder is there, and no link to one."""
    try:
        return stat.S_ISDIR(os.lstat(path).st_mode)
    except (OSError, ValueError):
        return False


def _has_links(objects: str) -> bool:
    """Return whether one of the objects is a link, or there are so many that nobody would look at all of them."""
    top = list(itertools.islice(_entries(objects), _MOST_FOLDERS + 1))
    if len(top) > _MOST_FOLDERS:
        return True
    inside = (_entries(one.path) for one in top if one.is_dir(follow_symlinks=False))
    every = enumerate(itertools.chain(top, itertools.chain.from_iterable(inside)))
    return any(number >= _MOST_OBJECTS or one.is_symlink() for number, one in every)


def _entries(folder: str) -> Iterator[os.DirEntry[str]]:
    with os.scandir(folder) as entries:
        yield from entries


def _packed(shared: Path, name: str) -> str:
    """Return what a reference is in the list of all of them, whose lines are `COMMIT NAME`.

    No name has a blank in it, so that where it is found first is its line, or the list is none of git's.
    """
    content = _content(shared / "packed-refs", _MOST_PACKED)
    at = content.find(os.fsencode(f" {name}\n"))
    return os.fsdecode(content[max(0, at - _LONGEST_COMMIT - 1) : at].rpartition(b"\n")[2]) if at >= 0 else ""


def _line(path: Path) -> str:
    return _text(path).removesuffix("\n")


def _text(path: Path) -> str:
    return os.fsdecode(_content(path, _MOST))


def _content(path: Path, most: int) -> bytes:
    """Return what a file holds; nothing of one that cannot be read, has what no name has, or has a link in its path.

    Nor of one that has another name, as an archive may give one to a file of the user's.
    """
    try:
        content, about = regular_file.read_with_status(path, most, real=True)
    except OSError:
        return b""
    return b"" if b"\0" in content or regular_file.has_further_names(about) else content
