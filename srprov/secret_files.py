"""Files of secrets that a user ever allowed on this machine: his own, whatever an experiment calls them by now.

Gives paths; reads the list of them, which `record.memory` writes below the user's folder for state. A list that is
missing or broken is an empty one.
"""

from __future__ import annotations

from pathlib import Path

from srprov import believed, private
from srprov.untrusted import mapping, parse_json

LONGEST = 4 << 20
"""Bytes of the list."""


def place() -> Path:
    """Return where the list is."""
    return private.state_folder() / "secret-files.json"


def known() -> frozenset[str]:
    """Return the real paths of files of secrets, of whatever experiment."""
    return frozenset(listed())


def listed() -> list[str]:
    """Return them in their order, the newest last; each as it was written, as a name need not be text."""
    try:
        kept = mapping(parse_json(believed.read(place(), LONGEST).decode()))
    except (OSError, ValueError):
        return []
    return [path for path, some in kept.items() if isinstance(some, list)]
