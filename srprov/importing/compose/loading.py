"""What is shared by all files of a project while it is read: what may be read, variables, and notes. Reads files."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Sequence
from dataclasses import dataclass, field

import msgspec

from srprov.errors import Diagnostic
from srprov.importing.compose import resets
from srprov.importing.compose.casts import interpolate
from srprov.importing.compose.source import Reading
from srprov.importing.compose.values import Value
from srprov.importing.compose.variables import Variables
from srprov.importing.normal import Note, Refused


class File(msgspec.Struct, frozen=True):
    """A Compose file: where it is, and what it is called in messages."""

    path: str
    shown: str
    named: Value | None = None
    """Where another file names it; None for the user's own."""

    def beside(self, folder: str, name: Value) -> File:
        """Return a file that this one names; `folder` is where its relative paths begin."""
        shown = os.path.normpath(
            os.path.join(os.path.dirname(self.shown), os.path.relpath(folder, os.path.dirname(self.path)))
        )
        return File(os.path.join(folder, name.data), os.path.normpath(os.path.join(shown, name.data)), name)


@dataclass
class Loading:
    """What is shared by all files of a project, and those of the projects that it includes."""

    reading: Reading
    variables: Variables
    folder: str
    """Where relative paths begin, absolute."""
    notes: list[Note] = field(default_factory=list)
    open: tuple[str, ...] = ()
    """Files that include one another down to here."""
    bases: dict[tuple[str, str], tuple[Value, resets.Resets]] = field(default_factory=dict)
    """Services of files that others extend, by path and shown name."""

    def within(self, folder: str, variables: Variables) -> Loading:
        """Return what an included project is read with."""
        return dataclasses.replace(self, folder=folder, variables=variables, bases={})


def first_look(file: File, loading: Loading) -> tuple[Value, resets.Resets]:
    """Return a file's tree with its variables put in, and what it resets.

    Raises:
        Refused: It cannot be read, or a variable has no value.
    """
    tree, reset = resets.taken(loading.reading.tree(file.path, file.shown, file.named))
    tree = interpolate(tree, loading.variables)
    if loading.variables.problems:
        raise Refused(_once(loading.variables.problems))
    loading.reading.note_secrets(tree, (loading.folder, os.path.dirname(os.path.abspath(file.path))))
    return tree, reset


def _once(problems: Sequence[Diagnostic]) -> list[Diagnostic]:
    """Return no more than a screenful, each once."""
    return list(dict.fromkeys(problems))[:100]
