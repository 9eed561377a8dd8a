"""What is in a folder that is open: its entries by their names there, no link followed."""

from __future__ import annotations

import contextlib
import errno
import os
import stat
from collections.abc import Sequence
from typing import BinaryIO

from srprov.codes import Code
from srprov.errors import UsageError, visible

FOLDER = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC
_FILE = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC


def open_folder(name: str, above: int, shown: str) -> int:
    """Open a folder in another one; `shown` is its path, for the user.

    Raises:
        UsageError: A file or link is there.
        OSError: It cannot be opened.
    """
    try:
        return os.open(name, FOLDER, dir_fd=above)
    except OSError as error:
        if error.errno not in (errno.ENOTDIR, errno.ELOOP):
            raise
        why = f"{visible(shown)}: a file or link is there, where a folder is to be"  # a container may have called it
        raise UsageError(why, code=Code.IN_THE_WAY) from None


def open_file(parts: Sequence[str], top: int) -> BinaryIO:
    """Open a file in the folders below an open one, to read it.

    Raises:
        OSError: It is not there, is no file, or lies behind a link.
    """
    folder = os.dup(top)
    try:
        for name in parts[:-1]:
            below = os.open(name, FOLDER, dir_fd=folder)
            os.close(folder)
            folder = below
        file = os.fdopen(os.open(parts[-1], _FILE, dir_fd=folder), "rb")
    finally:
        os.close(folder)
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        file.close()
        raise OSError(errno.EINVAL, "it is no file", "/".join(parts))
    return file


def is_folder(above: int, name: str) -> bool:
    """Return whether a folder is there."""
    try:
        return stat.S_ISDIR(os.stat(name, dir_fd=above, follow_symlinks=False).st_mode)
    except FileNotFoundError:
        return False


def make_like(descriptor: int, mode: int, when: float | None) -> None:
    """Give a file or folder permissions, never those that act as somebody else, and a time; None leaves that."""
    os.fchmod(descriptor, mode & 0o777)
    if when is None:
        return
    with contextlib.suppress(OverflowError, ValueError):  # a time that no file here can have
        os.utime(descriptor, (when, when))
