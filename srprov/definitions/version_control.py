"""What version control keeps in a folder: the addresses of clones, with tokens, and what else is its user's.

Takes paths without links; tells whether one lies there, by whatever name. Looks at the file system.
"""

from __future__ import annotations

import os

from srprov.definitions.model import VERSION_CONTROL


def is_kept(real: str, root: str) -> bool:
    """Return whether a path lies in a folder of version control's, below `root`, or is one.

    A disk may have further names for a file than the one that it lists: in any case, `GIT~1` on those of Windows, or
    with letters that do not count. So it is also told by what it is.
    """
    at = root
    for part in os.path.relpath(real, root).split(os.sep):
        if part.lower() in VERSION_CONTROL or any(_same(f"{at}/{part}", f"{at}/{name}") for name in VERSION_CONTROL):
            return True
        at = f"{at}/{part}"
    return False


def _same(path: str, other: str) -> bool:
    try:
        return os.path.samestat(os.lstat(path), os.lstat(other))
    except (OSError, ValueError):
        return False
