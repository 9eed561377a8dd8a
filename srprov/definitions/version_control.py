"""What version control keeps in a folder: the addresses of clones, with tokens, and what else is its user's.

Takes paths without links; tells whether one lies there, by whatever name. Looks at the file system.
"""

from __future__ import annotations

import itertools
import os
import stat
from collections.abc import Iterator
from pathlib import Path

from srprov import regular_file
from srprov.definitions.model import VERSION_CONTROL, VERSION_CONTROL_IN_ANY_CASE
from srprov.yamldoc.allowance import current


def is_kept(real: str, root: str) -> bool:
    """Return whether a path lies in a folder of version control's, below `root`, or is one.

    A disk may have further names for a file than the one that it lists: in any case, `GIT~1` on those of Windows, or
    with letters that do not count. So it is also told by what it is, and so is a file that an archive, unpacked there,
    gave a second name (a hard link).
    """
    at = root
    for part in os.path.relpath(real, root).split(os.sep):
        if part.casefold() in VERSION_CONTROL_IN_ANY_CASE:
            return True
        if any(_same(f"{at}/{part}", f"{at}/{name}") for name in VERSION_CONTROL):
            return True
        at = f"{at}/{part}"
    try:
        about = os.lstat(real)
    except (OSError, ValueError):  # who reads it says so
        return False
    return has_further_names(about) and (about.st_dev, about.st_ino) in with_further_names(root)


def has_further_names(about: os.stat_result) -> bool:
    """Return whether a file has more than one name on its disk."""
    return stat.S_ISREG(about.st_mode) and about.st_nlink > 1


def with_further_names(root: str) -> frozenset[tuple[int, int]]:
    """Return, as the kernel knows them, those files with several names that version control keeps below or above."""
    left = current.get()
    known = left.kept if left else {}
    if root not in known:
        known[root] = frozenset(
            (about.st_dev, about.st_ino) for about in map(_status, _files(root)) if about and has_further_names(about)
        )
    return known[root]


def _files(root: str) -> Iterator[str]:
    """Return the paths of all files that version control keeps in a folder, at any depth, and in those above it."""
    tops = [str(above / name) for above in Path(root).parents for name in VERSION_CONTROL]
    for parent, folders, files in regular_file.walk(root):
        kept = [one for one in (*folders, *files) if one.casefold() in VERSION_CONTROL_IN_ANY_CASE]
        tops += [os.path.join(parent, one) for one in kept]
        folders[:] = [one for one in folders if one not in kept]
    for top in filter(os.path.lexists, tops):
        below = ((parent, files) for parent, _, files in regular_file.walk(top))
        yield from itertools.chain([top], (os.path.join(parent, one) for parent, files in below for one in files))


def _status(path: str) -> os.stat_result | None:
    try:
        return os.lstat(path)
    except OSError:  # it is gone, or nobody may look: then nothing of it is shipped
        return None


def _same(path: str, other: str) -> bool:
    try:
        return os.path.samestat(os.lstat(path), os.lstat(other))
    except (OSError, ValueError):
        return False
