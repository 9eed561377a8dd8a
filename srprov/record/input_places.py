"""Where a record has each file that an experiment was read from. Pure."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import PurePosixPath

from srprov.definitions.repository_names import repositories_among

_DEEPEST = 20
_LONGEST_NAME = 200
"""Bytes; a file is written beside its place first, under a longer name."""


def inputs(files: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """Return each definition file by a name below inputs/; one from outside the EDF's folder lies below outside/.

    A plan file may say any names, and a project may be what a repository is made of, though it is none where it was
    cloned: what cannot be a file beside the others, is srprov's own, or would make a repository here, lies in other/.
    """
    places = list(_places(files))
    strange = set(repositories_among(place for place, _ in places))
    for number, (place, text) in enumerate(places, 1):
        yield f"other/{number}" if place in strange else place, text


def _places(files: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """Yield each in the order of the names; what has the n-th of them and fits nowhere is `other/n`."""
    taken, folders = {"inventory.yml", "other"}, set[str]()
    for number, (name, text) in enumerate(sorted(files.items()), 1):
        parts = [part for part in PurePosixPath(name).parts if part not in ("/", "..", ".")]
        parts = ["outside", *parts] if name.startswith(("/", "..")) else parts
        place, above = "/".join(parts), {"/".join(parts[:depth]) for depth in range(1, len(parts))}
        fits = parts and len(parts) <= _DEEPEST and all(len(os.fsencode(one)) <= _LONGEST_NAME for one in parts)
        if not fits or not place.isprintable() or place in taken | folders or above & taken:
            place, above = f"other/{number}", set()
        taken.add(place)
        folders |= above
        yield place, text
