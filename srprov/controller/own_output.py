"""Whether a folder that srprov writes to is part of what an experiment ships: then each run would change the next.

Takes definitions and a folder; gives what ships it, and refuses it for trials. An image would be built anew with what
the run before kept, and what was planned would differ from what lies there as soon as the folder is made.
"""

from __future__ import annotations

import os
from pathlib import Path

import msgspec

from srprov.codes import Code
from srprov.controller.own_files import has_names_elsewhere
from srprov.definitions.model import Definitions
from srprov.errors import UsageError

_KEPT = ("journal.jsonl", "trials.csv", "trials/1/log", "sessions/1/inputs.json")
"""Names in the folder: a `.dockerignore` leaves it out where it leaves out all of them."""


class Shipping(msgspec.Struct, frozen=True):
    """What ships a folder."""

    source: str
    """A folder of the controller."""
    built: bool
    """It is a Dockerfile's, with a `.dockerignore`."""
    path: str
    """Of the folder, below it."""

    @property
    def remedy(self) -> str:
        """Return what to do about it, as a hint has it."""
        elsewhere = "name a folder elsewhere with -o"
        ignore = os.path.join(self.source, ".dockerignore")
        return f"{elsewhere}, or leave it out by a line '/{self.path}' in {ignore}" if self.built else elsewhere


def shipping(definitions: Definitions, folder: Path) -> Shipping | None:
    """Return what of an experiment ships what is written into a folder, or nothing does.

    What cannot be looked through ships nothing here; the plan says why.
    """
    real = os.path.realpath(folder)
    containers = definitions.containers.values()
    every = [mount for one in definitions.experiment.services.values() for mount in one.runtime.mounts]
    trees = {mount.source for mount in every if mount.kind == "tree"} | {one.seed.path for one in every if one.seed}
    trees |= {file.source for one in containers for file in one.files if not one.image}
    contexts = {one.context or os.path.dirname(one.dockerfile) for one in containers if one.dockerfile}
    home = os.path.realpath(definitions.experiment.folder)
    for source in sorted(trees | contexts):
        path = os.path.relpath(real, os.path.realpath(source))
        if path.split("/")[0] == ".." or not os.path.isdir(source):
            continue
        if source in trees and _of_a_tree(path):
            return Shipping(source, built=False, path=path)
        if source in contexts and _of_a_context(source, path, home):
            return Shipping(source, built=True, path=path)
    return None


def refuse_shipped(definitions: Definitions, folder: Path) -> None:
    """Refuse a folder for trials that their experiment ships.

    Raises:
        UsageError: So it is.
    """
    if (by := shipping(definitions, folder)) is not None:
        what = "the files that an image is built with" if by.built else "what robots get"
        message = f"{folder} is in {by.source}, and so among {what}: the run would change its own experiment"
        raise UsageError(message, hint=by.remedy, code=Code.IN_THE_WAY)


def _of_a_tree(path: str) -> bool:
    from srprov.images.plan import LEFT_OUT

    return not set(path.split("/")) & set(LEFT_OUT)


def _of_a_context(source: str, path: str, home: str) -> bool:
    """Return whether a build context holds what is written below a path, by the rules that made it.

    Where the `.dockerignore` is a file of the user's to which an archive gave that name, it does not: nothing may
    depend on what that file says.
    """
    from srprov import disk
    from srprov.images.context import folder_items
    from srprov.images.plan import ListedFile

    if not _of_a_tree(path) or has_names_elsewhere(f"{source}/.dockerignore", home):
        return False
    new = [os.path.normpath(os.path.join(path, name)) for name in _KEPT]
    try:
        items = folder_items(source, lambda at: [*disk.listing(at), *map(ListedFile, new)], disk.read)
    except (OSError, ValueError):
        return False
    return not {one.path for one in items}.isdisjoint(new)
