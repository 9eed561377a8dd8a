"""The experiment's own files on the controller's disk, as values. Reads files, changes nothing.

What is shipped is held in memory, so that it has limits, which are checked before anything is read. Paths come from
the definitions, which followed links and checked where they lead: a link on the way to a file now was put there since,
and is refused.
"""

from __future__ import annotations

import errno
import io
import itertools
import os
import stat
import tarfile
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field

import msgspec

from srprov import regular_file
from srprov.images.plan import LEFT_OUT, ListedFile

MAX_BYTES = 96 * regular_file.MIB
"""Of all that an experiment ships, and so of one file or folder, which definitions/paths.py tells at its line. It is
held twice while a tar is made of it."""
MAX_FILES = 50_000
"""Below all folders that are shipped, also those that a `.dockerignore` leaves out."""


@dataclass
class _Budget:
    """How much may still be shipped, and what has been read."""

    left: int = MAX_BYTES
    files: int = MAX_FILES
    contents: dict[str, bytes] = field(default_factory=dict)
    """By path; a file that is shipped under several names is held once."""

    def read(self, path: str, *, keep: bool = True) -> bytes:
        """Return a file's content, which counts each time that it is shipped."""
        try:
            content = self.contents[path] if path in self.contents else regular_file.read(path, self.left, real=True)
        except OSError as error:
            raise _too_much(path) if error.errno == errno.EFBIG else error from None
        if len(content) > self.left:
            raise _too_much(path)
        if keep:
            self.contents[path] = content
        self.left -= len(content)
        return content


_budget: ContextVar[_Budget | None] = ContextVar("budget", default=None)


@contextmanager
def together() -> Iterator[None]:
    """Let all that is read in the block count against one limit."""
    token = _budget.set(_Budget())
    try:
        yield
    finally:
        _budget.reset(token)


def _too_much(path: str) -> OSError:
    most = f"{MAX_BYTES // regular_file.MIB} MiB or {MAX_FILES} files"
    return OSError(errno.EFBIG, f"with it, all that is shipped is more than {most}", path)


def read(path: str) -> bytes:
    """Return a file's content.

    Raises:
        OSError: It cannot be read, is no regular file or too large.
    """
    return (_budget.get() or _Budget()).read(path)


def left() -> int:
    """Return how many bytes may still be shipped."""
    return (_budget.get() or _Budget()).left


def spend(what: str, size: int, files: int) -> None:
    """Count what is shipped but was read elsewhere, `size` bytes in `files` files, against the limit.

    Raises:
        OSError: With it, all is too much.
    """
    budget = _budget.get() or _Budget()
    if size > budget.left or files > budget.files:
        raise _too_much(what)
    budget.left -= size
    budget.files -= files


def listing(path: str) -> Iterator[ListedFile]:
    """Return every file below a folder, or the one file that `path` is; symbolic links are not followed.

    Raises:
        OSError: It cannot be read, holds too much, or something that is no file.
    """
    yield from _listed(path, ())


def shipped(path: str) -> Iterator[ListedFile]:
    """Return of a file or folder just what `tree_tar` takes of it; what is left out there is not even looked into.

    Raises:
        OSError: As `tree_tar`.
    """
    yield from _listed(path, LEFT_OUT)


def _listed(path: str, without: Collection[str]) -> Iterator[ListedFile]:
    about = os.stat(path, follow_symlinks=False)
    if not stat.S_ISDIR(about.st_mode):
        yield ListedFile("", executable=bool(about.st_mode & 0o111) and os.access(path, os.X_OK))
        return
    for one in _below(path, without):
        if one.link is not None:
            yield ListedFile(one.path, link=one.link)
        elif stat.S_ISREG(one.mode):
            yield ListedFile(one.path, executable=bool(one.mode & 0o100))


class _Found(msgspec.Struct, frozen=True):
    """Something below a folder."""

    path: str
    """Relative to it."""
    mode: int
    link: str | None


def _below(root: str, without: Collection[str] = ()) -> list[_Found]:
    """Return everything below a folder, sorted; raises OSError when that is too much, or a link took a folder's place.

    What has one of the names `without` is left out at any depth.

    Each folder is read by its descriptor: what stands in the list was in that folder, and nowhere else.
    """
    budget = _budget.get() or _Budget()
    found, folders = list[_Found](), [""]
    while folders:
        folder = folders.pop()
        with regular_file.real_folder(os.path.join(root, folder).rstrip("/")) as descriptor:
            for one in itertools.islice(os.scandir(descriptor), budget.files + 1):
                if one.name in without:
                    continue
                found.append(_found(os.path.join(folder, one.name), one, descriptor))
                if stat.S_ISDIR(found[-1].mode):
                    folders.append(found[-1].path)
        if len(found) > budget.files:
            raise _too_much(root)
    budget.files -= len(found)
    return sorted(found, key=lambda one: one.path.split("/"))


def _found(path: str, one: os.DirEntry[str], folder: int) -> _Found:
    mode = one.stat(follow_symlinks=False).st_mode
    return _Found(path, mode, os.readlink(one.name, dir_fd=folder) if stat.S_ISLNK(mode) else None)


def tree_tar(path: str) -> bytes:
    """Return a file or folder as a tar with one top entry, equal for equal content: sorted, no owners, no times.

    `.git` and the like below it are left out, which hold tokens and differ between clones; so a path to one gives what
    is in it. What the folders above are called says nothing: who has a project cloned chooses that.

    Raises:
        OSError: It cannot be read, holds too much, or something that is no file.
    """
    buffer, name, budget = io.BytesIO(), os.path.basename(path), _budget.get() or _Budget()
    mode = os.stat(path, follow_symlinks=False).st_mode
    below = _below(path, LEFT_OUT) if stat.S_ISDIR(mode) else []
    with tarfile.open(fileobj=buffer, mode="w", format=tarfile.PAX_FORMAT) as tar:
        for one in [_Found("", mode, None), *below]:
            entry = tarfile.TarInfo(os.path.join(name, one.path).rstrip("/"))
            # what counts is whether somebody may run it; the rest differs between checkouts
            entry.mode = 0o755 if stat.S_ISDIR(one.mode) or one.mode & 0o100 else 0o644
            if one.link is not None:
                entry.type, entry.linkname = tarfile.SYMTYPE, one.link
                tar.addfile(entry)
            elif stat.S_ISDIR(one.mode):
                entry.type = tarfile.DIRTYPE
                tar.addfile(entry)
            else:
                content = budget.read(os.path.join(path, one.path).rstrip("/"), keep=False)
                entry.size = len(content)
                tar.addfile(entry, io.BytesIO(content))
    return buffer.getvalue()
