"""The way to a path, link by link as the kernel goes it -> whether it stays in a folder.

A path may lead out of an experiment's folder and come back: by what it meets outside, it tells what is there. Nothing
outside is looked at here. Takes paths; looks at the file system.
"""

from __future__ import annotations

import enum
import os
import stat
from typing import NamedTuple

from srprov import regular_file
from srprov.definitions.homes import homes_in
from srprov.definitions.model import VERSION_CONTROL_IN_ANY_CASE
from srprov.definitions.version_control import is_from_elsewhere

_MOST_LINKS = 40
"""On one way; source: the kernel's own limit."""


class Ends(enum.Enum):
    """How a way goes."""

    INSIDE = "it stays in the folder"
    KEPT = "it leads to what version control keeps there, or into a home"
    STRANGE = "it leads by a link to which an archive gave a name there"
    OUT = "it leads out of the folder"


class Way(NamedTuple):
    """How a way goes, and where: a path without links if it stays, else the one at which nothing more is looked at."""

    ends: Ends
    place: str


def way_to(path: str, folder: str) -> Way:
    """Follow a path, absolute and without `..`, that a file in a folder names."""
    root = os.path.realpath(folder)
    left = _parts_below(path, os.path.abspath(folder), root)
    if left is None:
        return Way(Ends.OUT, path)
    at, links, homes = list[str](), 0, homes_in(root)
    while left:
        part = left.pop()
        if part in ("", "."):
            continue
        if part == "..":
            if not at:
                return Way(Ends.OUT, _joined(root, [part], left))
            at.pop()
            continue
        here = os.path.join(root, *at, part)
        if part.casefold() in VERSION_CONTROL_IN_ANY_CASE or here in homes:
            return Way(Ends.KEPT, _joined(root, [*at, part], left))
        to = _link(here, root)
        if to is None:
            at.append(part)
            continue
        links += 1
        if not to or links > _MOST_LINKS:
            return Way(Ends.STRANGE, here)
        further = reversed(to.split("/"))
        if to.startswith("/"):
            below = _parts_below(to, root)
            if below is None:
                return Way(Ends.OUT, _joined(to, [], left))
            at, further = [], iter(below)
        left += further
    return Way(Ends.INSIDE, os.path.join(root, *at))


def _link(path: str, root: str) -> str | None:
    """Return where a link leads; None for what is none, or not there, and "" for one that is nobody's to follow."""
    try:
        about = os.lstat(path)
        if not stat.S_ISLNK(about.st_mode):
            return None
        strange = regular_file.has_further_names(about) and is_from_elsewhere(about, root)
        return "" if strange else os.readlink(path)
    except (OSError, ValueError):  # who reads it says so
        return None


def _parts_below(path: str, *folders: str) -> list[str] | None:
    """Return the parts of a path below one of some folders, the last one first; None where it begins in none."""
    for folder in folders:
        if path == folder or path.startswith(f"{folder.rstrip('/')}/"):
            return path[len(folder) :].split("/")[::-1]
    return None


def _joined(root: str, parts: list[str], left: list[str]) -> str:
    """Return a path as it goes on, without `..` where only what was looked at would tell what that is."""
    path = os.path.join(root, *parts, *(one.lstrip("/") for one in reversed(left)))
    behind = path[len(root) :].lstrip("./")
    return path if ".." in behind.split("/") else os.path.normpath(path)
