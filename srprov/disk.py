"""The experiment's own files on the controller's disk, as values. Reads files, changes nothing.

What is shipped is held in memory, so that it has limits, which are checked before anything is read.
"""

from __future__ import annotations

import errno
import io
import itertools
import os
import tarfile
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path

from srprov import regular_file
from srprov.images.plan import ListedFile

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
    """By real path; a file that is shipped under several names is held once."""

    def read(self, path: str | Path, *, keep: bool = True) -> bytes:
        """Return a file's content, which counts each time that it is shipped."""
        real = os.path.realpath(path)
        try:
            content = self.contents[real] if real in self.contents else regular_file.read(path, self.left)
        except OSError as error:
            raise _too_much(path) if error.errno == errno.EFBIG else error from None
        if len(content) > self.left:
            raise _too_much(path)
        if keep:
            self.contents[real] = content
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


def _too_much(path: str | Path) -> OSError:
    most = f"{MAX_BYTES // regular_file.MIB} MiB or {MAX_FILES} files"
    return OSError(errno.EFBIG, f"with it, all that is shipped is more than {most}", os.fspath(path))


def read(path: str) -> bytes:
    """Return a file's content.

    Raises:
        OSError: It cannot be read, is no regular file or too large.
    """
    return (_budget.get() or _Budget()).read(path)


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
    root = Path(path)
    if not root.is_dir():
        yield ListedFile(
            "", executable=os.access(path, os.X_OK, follow_symlinks=True) and bool(root.stat().st_mode & 0o111)
        )
        return
    for one in _below(root):
        name = one.relative_to(root).as_posix()
        if one.is_symlink():
            yield ListedFile(name, link=os.readlink(one))
        elif one.is_file():
            yield ListedFile(name, executable=bool(one.stat().st_mode & 0o100))


def _below(root: Path) -> list[Path]:
    """Return everything below a folder, sorted; raises OSError when that is too much."""
    budget = _budget.get() or _Budget()
    found = list(itertools.islice(root.rglob("*"), budget.files + 1))
    if len(found) > budget.files:
        raise _too_much(root)
    budget.files -= len(found)
    return sorted(found)


def tree_tar(path: str) -> bytes:
    """Return a file or folder as a tar with one top entry, equal for equal content: sorted, no owners, no times.

    Raises:
        OSError: It cannot be read, holds too much, or something that is no file.
    """
    buffer, root, budget = io.BytesIO(), Path(path), _budget.get() or _Budget()

    def neutral(entry: tarfile.TarInfo) -> tarfile.TarInfo:
        entry.uid = entry.gid = entry.mtime = 0
        entry.uname = entry.gname = ""
        # what counts is whether somebody may run it; the rest differs between checkouts
        entry.mode = 0o755 if entry.isdir() or entry.mode & 0o100 else 0o644
        return entry

    with tarfile.open(fileobj=buffer, mode="w", format=tarfile.PAX_FORMAT) as tar:
        for one in [root, *_below(root)] if root.is_dir() else [root]:
            entry = tar.gettarinfo(one, arcname=str(Path(root.name) / one.relative_to(root)))
            if one.is_symlink() or one.is_dir():
                tar.addfile(neutral(entry))
                continue
            content = budget.read(one, keep=False)
            entry.type, entry.linkname, entry.size = tarfile.REGTYPE, "", len(content)
            tar.addfile(neutral(entry), io.BytesIO(content))
    return buffer.getvalue()
