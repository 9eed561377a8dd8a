"""Inventories of records that this machine wrote: they are their user's own word, and any other one is not.

A record, or a bundle, may come from anybody. Gives whether one is known; reads the list, which `record.memory` writes
below the user's folder for state. A list that is missing or broken is an empty one.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

from srprov import believed, private, regular_file
from srprov.untrusted import mapping, parse_json

LONGEST = 4 << 20
"""Bytes of the list."""


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
