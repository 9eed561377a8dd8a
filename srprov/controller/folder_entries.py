"""What is in a folder that is open: its entries by their names there, no link followed."""

from __future__ import annotations

import contextlib
import errno
import os
import stat

from srprov.codes import Code
from srprov.errors import UsageError

FOLDER = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC


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
        raise UsageError(f"{shown}: a file or link is there, where a folder is to be", code=Code.IN_THE_WAY) from None


def is_folder(above: int, name: str) -> bool:
    """Return whether a folder is there."""
    try:
        return stat.S_ISDIR(os.stat(name, dir_fd=above, follow_symlinks=False).st_mode)
    except FileNotFoundError:
        return False


def link_at(folder: int, name: str) -> str:
    """Return what the link says that is there; nothing where there is none."""
    try:
        return os.readlink(name, dir_fd=folder)
    except OSError:
        return ""


def make_like(descriptor: int, mode: int, when: float) -> None:
    """Give a file or folder the permissions and the time of its header; never those that act as somebody else."""
    os.fchmod(descriptor, mode & 0o777)
    with contextlib.suppress(OverflowError, ValueError):  # a time that no file here can have
        os.utime(descriptor, (when, when))
