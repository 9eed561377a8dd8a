"""Files that a secret was ever read from on this machine: the user's own, whatever an experiment calls them by now.

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
    """Return the real paths of files that a secret was read from, by whatever experiment."""
    try:
        kept = mapping(parse_json(believed.read(place(), LONGEST).decode()))
    except (OSError, ValueError):
        return frozenset()
    return frozenset(path for path, some in kept.items() if isinstance(some, list))
