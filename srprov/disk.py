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
from pathlib import Path

from srprov import regular_file
from srprov.images.plan import ListedFile

MAX_BYTES = 256 * regular_file.MIB
"""Of one file or folder that is shipped; definitions/paths.py tells it at its line."""
MAX_FILES = 50_000
"""Below one folder, also those that a `.dockerignore` leaves out."""


def read(path: str) -> bytes:
    """Return a file's content.

    Raises:
        OSError: It cannot be read, is no regular file or too large.
    """
    return regular_file.read(path, MAX_BYTES)


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
    found = list(itertools.islice(root.rglob("*"), MAX_FILES + 1))
    if len(found) > MAX_FILES:
        raise OSError(errno.EFBIG, f"it holds more than {MAX_FILES} files", str(root))
    return sorted(found)


def tree_tar(path: str) -> bytes:
    """Return a file or folder as a tar with one top entry, equal for equal content: sorted, no owners, no times.

    Raises:
        OSError: It cannot be read, holds too much, or something that is no file.
    """
    buffer, root, left = io.BytesIO(), Path(path), MAX_BYTES

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
            content = regular_file.read(one, left)
            left -= len(content)
            entry.type, entry.linkname, entry.size = tarfile.REGTYPE, "", len(content)
            tar.addfile(neutral(entry), io.BytesIO(content))
    return buffer.getvalue()
