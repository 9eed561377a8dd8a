"""srprov's own records: what lies in one, and whether this machine wrote the inventory of one.

A record, or a bundle, may come from anybody, and only an inventory that this machine wrote is its user's own word. The
list of these is read, which `record.memory` writes below the user's folder for state. A list that is missing or broken
is an empty one.
"""

from __future__ import annotations

import hashlib
import itertools
import os
from collections.abc import Callable
from pathlib import Path

from srprov import believed, private, regular_file
from srprov.untrusted import mapping, parse_json

LONGEST = 4 << 20
"""Bytes of the list."""
KEPT_OUT = "*\n!.gitignore\n"
"""What an export's `.gitignore` says beside the files of secrets that somebody puts there."""
_MARKS = (("events.jsonl", "environment.json"), ("journal.jsonl", "trials"))
"""Names that stand together in the folder of a run, and in that of trials or of their bundle."""


def is_record(folder: str) -> bool:
    """Return whether a folder is a record, one of an export's secrets, or the user's folder for state and tokens."""
    there = (all(os.path.lexists(os.path.join(folder, name)) for name in names) for names in _MARKS)
    return any(there) or _has_secrets(folder) or os.path.realpath(folder) == os.path.realpath(place().parent)


def _has_secrets(folder: str) -> bool:
    try:
        return regular_file.read(os.path.join(folder, ".gitignore"), len(KEPT_OUT)) == KEPT_OUT.encode()
    except OSError:
        return False


def record_of(path: str, top: str = os.sep, is_one: Callable[[str], bool] = is_record) -> str:
    """Return the outermost record below a folder in which a path lies, or which it is; or nothing. Both are real."""
    parts = os.path.relpath(path, top).split(os.sep)
    below = itertools.islice(itertools.accumulate(parts, os.path.join, initial=top), 1, None)
    return next(filter(is_one, below), "") if parts[0] not in (os.curdir, os.pardir) else ""


def record_around(path: str, top: str, is_one: Callable[[str], bool] = is_record) -> str:
    """Return the record in which a file or folder lies, or which it is, that a file in `top` names; or nothing.

    What is in `top` is in a record only where that one lies there, too: an experiment in a bundle has its own files.
    Both are real.
    """
    is_there = path == top or path.startswith(f"{top.rstrip(os.sep)}{os.sep}")
    return record_of(path, top if is_there else os.sep, is_one)


def place() -> Path:
    """Return where the list is."""
    return private.state_folder() / "inventories.json"


def digest(content: bytes) -> str:
    """Return what an inventory is known by."""
    return hashlib.sha256(content).hexdigest()


def is_known(file: str) -> bool:
    """Return whether this machine wrote what is in a file, of an inventory that its user had named."""
    try:
        made = digest(regular_file.read(file))
        return made in mapping(parse_json(believed.read(place(), LONGEST).decode()))
    except (OSError, ValueError):
        return False
