"""Whether an inventory of a lab is still what `lab up` wrote. Reads files.

It lies in whatever folder the lab was brought up in, which may be a clone of a stranger's project, and its user names
it, so that it may have keys and options of ssh. Git replaces a file that it was told to ignore without a word: the next
`git pull` may bring another one in its place, with a program of the stranger's.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Collection, Iterator
from pathlib import Path

from srprov import regular_file
from srprov.lab import state
from srprov.lab.inventory import HEADER
from srprov.lab.places import NAMED_RUN, Site


def digest(text: str) -> str:
    """Return what the text of an inventory is known by."""
    return hashlib.sha256(text.encode()).hexdigest()


def has_header(path: str | Path) -> bool:
    """Return whether a file begins as an inventory of a lab; what is a link, or cannot be read, does not."""
    try:
        return not os.path.islink(path) and regular_file.beginning(path, len(HEADER)) == HEADER.encode()
    except OSError:
        return False


def lies_there(path: str | Path) -> bool:
    """Return whether no link leads to the folder of a file: whoever can put one there says where the file is."""
    folder = os.path.dirname(path)
    return os.path.realpath(folder) == folder


def changed(paths: Collection[str]) -> str:
    """Return the first inventory of a lab among some paths, or in folders among them, that is another one by now."""
    named = {os.path.realpath(path) for path in paths if "\0" not in path}
    for lab in _labs():
        for path in lab.inventories if lab.written else ():
            places = {os.path.realpath(path), os.path.realpath(os.path.dirname(path))}
            if os.path.lexists(path) and places & named and not _is(path, lab.written):
                return path
    return ""


def _labs() -> Iterator[state.Lab]:
    names = sorted(path.name for path in NAMED_RUN.glob("*/")) if NAMED_RUN.is_dir() else []
    for name in ["", *names]:
        try:
            lab = state.read_lab(Site(name, None))
        except OSError:  # of somebody else's, who alone may read it
            continue
        if lab:
            yield lab


def _is(path: str, written: str) -> bool:
    try:
        return not os.path.islink(path) and digest(regular_file.read(Path(path)).decode()) == written
    except (OSError, ValueError):
        return False
