"""The experiment's own files on the controller's disk, as values. Reads files, changes nothing."""

from __future__ import annotations

import io
import os
import tarfile
from collections.abc import Iterator
from pathlib import Path

from srprov.images.plan import ListedFile


def read(path: str) -> bytes:
    """Return a file's content."""
    return Path(path).read_bytes()


def listing(path: str) -> Iterator[ListedFile]:
    """Return every file below a folder, or the one file that `path` is; symbolic links are not followed.

    Raises:
        OSError: It cannot be read.
    """
    root = Path(path)
    if not root.is_dir():
        yield ListedFile(
            "", executable=os.access(path, os.X_OK, follow_symlinks=True) and bool(root.stat().st_mode & 0o111)
        )
        return
    for one in sorted(root.rglob("*")):
        name = one.relative_to(root).as_posix()
        if one.is_symlink():
            yield ListedFile(name, link=os.readlink(one))
        elif one.is_file():
            yield ListedFile(name, executable=bool(one.stat().st_mode & 0o100))


def tree_tar(path: str) -> bytes:
    """Return a file or folder as a tar with one top entry, equal for equal content: sorted, no owners, no times."""
    buffer, root = io.BytesIO(), Path(path)

    def neutral(entry: tarfile.TarInfo) -> tarfile.TarInfo:
        entry.uid = entry.gid = entry.mtime = 0
        entry.uname = entry.gname = ""
        # what counts is whether somebody may run it; the rest differs between checkouts
        entry.mode = 0o755 if entry.isdir() or entry.mode & 0o100 else 0o644
        return entry

    with tarfile.open(fileobj=buffer, mode="w", format=tarfile.PAX_FORMAT) as tar:
        for one in [root, *sorted(root.rglob("*"))] if root.is_dir() else [root]:
            tar.add(one, arcname=str(Path(root.name) / one.relative_to(root)), recursive=False, filter=neutral)
    return buffer.getvalue()
