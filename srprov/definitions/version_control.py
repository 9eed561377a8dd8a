"""What lies in a folder and is not its own: what version control keeps there, and what has a name elsewhere, too.

Version control keeps the addresses of clones, with tokens, and what else is its user's. An archive gives any file of
its user's a second name (a hard link) where it is unpacked. Takes paths without links; looks at the file system.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Mapping
from typing import TypeAlias

from srprov import own_records, regular_file
from srprov.definitions.homes import homes_in
from srprov.definitions.model import VERSION_CONTROL, VERSION_CONTROL_IN_ANY_CASE
from srprov.yamldoc.allowance import current

Names: TypeAlias = Mapping[tuple[int, int], int]
"""A file that has several, as the kernel knows it -> how many of them are in a folder."""
ELSEWHERE = "it has another name, elsewhere (a hard link)"


def is_kept(real: str, root: str) -> bool:
    """Return whether a path lies in a folder of version control's, below `root`, or is one, or is from elsewhere.

    A disk may have further names for a file than the one that it lists: in any case, `GIT~1` on those of Windows, or
    with letters that do not count. So it is also told by what it is.
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
    return is_from_elsewhere(about, root)


def is_from_elsewhere(about: os.stat_result, root: str, names: Callable[[str], Names] | None = None) -> bool:
    """Return whether a file has a name that is not in a folder, or that version control keeps there.

    An archive may have given it the one in the folder. Nobody can know where its other names are, only how many.
    `names` are those of a folder, where they are known already.
    """
    known = (about.st_dev, about.st_ino)
    return regular_file.has_further_names(about) and about.st_nlink > (names or names_in)(root).get(known, 0)


def names_in(root: str) -> Names:
    """Return how many names each file with several has in a folder, without what is its user's there.

    That is what version control keeps, and what lies in a record: who unpacks an archive may have those there, too.
    Files are known as the kernel knows them. One that is not there has none. In a folder that is a home, or holds one,
    no name is its own: what an archive that was unpacked there gave another one lies there, too.
    """
    left = current.get()
    known = left.names if left else {}
    if root not in known:
        known[root] = found = Counter[tuple[int, int]]()
        for parent, folders, files in () if homes_in(root) else regular_file.walk(root):
            folders[:] = [one for one in folders if not _is_users(parent, one)]
            own = (one for one in (*files, *folders) if one.casefold() not in VERSION_CONTROL_IN_ANY_CASE)
            for about in (_status(os.path.join(parent, one)) for one in own):
                if about and regular_file.has_further_names(about):
                    found[about.st_dev, about.st_ino] += 1
    return known[root]


def _is_users(parent: str, folder: str) -> bool:
    return folder.casefold() in VERSION_CONTROL_IN_ANY_CASE or own_records.is_record(os.path.join(parent, folder))


def _status(path: str) -> os.stat_result | None:
    try:
        return os.lstat(path)
    except OSError:  # it is gone
        return None


def _same(path: str, other: str) -> bool:
    try:
        return os.path.samestat(os.lstat(path), os.lstat(other))
    except (OSError, ValueError):
        return False
