"""Folders of a project's files: which of them a file may name, and what leads out of one. Looks at the file system."""

from __future__ import annotations

import os
from collections.abc import Collection, Sequence

from srprov.definitions.paths import inside


def innermost(folders: Collection[str], file: str) -> str:
    """Return the innermost of some folders around a file; empty where none is. Real paths."""
    return max((one for one in folders if inside(file, one)), key=len, default="")


def led_away(path: str, folders: Collection[str]) -> bool:
    """Return whether a link on a path's way leads out of the innermost of some folders in which it lies.

    Whoever names the path may name what lies there; but where the link leads is the word of whose folder it is in.
    """
    at = os.sep
    for part in os.path.abspath(path).split(os.sep):
        further = os.path.join(at, part)
        real = os.path.realpath(further) if os.path.islink(further) else further
        if real != further and (home := innermost(folders, at)) and not inside(real, home):
            return True
        at = real
    return False


def open_to(roots: Sequence[str], near: Collection[str]) -> list[str]:
    """Return the folders of which a file may name others: those in each that is `near` it, and in one of `roots`.

    One of several files may be a stranger's, whether the user named it or has it included by his own. What lies beside
    another one, also further up, is then the user's. Real paths.
    """
    own = [one if any(inside(one, root) for root in roots) else "" for one in near]
    return [one for one in dict.fromkeys((*roots, *own)) if own and all(each and inside(one, each) for each in own)]
