"""Removes folders with all that lies in them, however deep that is: `shutil.rmtree` ends a thousand folders deep.

A container makes any number of folders in each other, and a stranger's file may lie in as many. Writes files only.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator

_FOLDER = os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC


def remove(top: str | os.PathLike[str]) -> None:
    """Remove a folder; what cannot be removed stays, and so does what holds it. No link is followed.

    One folder is open at a time, and `..` leads back: a path from the top could be longer than the kernel takes.
    """
    above, name = os.path.split(os.path.abspath(top))
    try:
        here = os.open(above, _FOLDER)
    except OSError:
        return
    entered = [_identity(here)]
    names: list[str] = []
    left = [[name]]
    """In each folder that was entered, those that are still to be removed."""
    try:
        while left:
            if left[-1]:
                name = left[-1].pop()
                with contextlib.suppress(OSError):
                    here = _turned(here, name, os.O_NOFOLLOW)
                    names.append(name)
                    entered.append(_identity(here))
                    left.append(list(_emptied(here)))
                continue
            left.pop()
            if not names:
                return
            here = _turned(here, "..")
            entered.pop()
            if _identity(here) != entered[-1]:  # somebody moved it meanwhile
                return
            with contextlib.suppress(OSError):
                os.rmdir(names.pop(), dir_fd=here)
    except OSError:
        return  # not even the way back is there
    finally:
        os.close(here)


def _turned(here: int, name: str, flags: int = 0) -> int:
    """Open another folder in place of one."""
    there = os.open(name, _FOLDER | flags, dir_fd=here)
    os.close(here)
    return there


def _identity(folder: int) -> tuple[int, int]:
    about = os.fstat(folder)
    return about.st_dev, about.st_ino


def _emptied(folder: int) -> Iterator[str]:
    """Remove all that lies in a folder but for the folders, which are named."""
    with contextlib.suppress(OSError), os.scandir(folder) as found:
        for one in list(found):
            if one.is_dir(follow_symlinks=False):
                yield one.name
            else:
                with contextlib.suppress(OSError):
                    os.unlink(one.name, dir_fd=folder)
