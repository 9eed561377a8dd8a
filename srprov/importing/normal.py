"""A Compose project as its own tool would print it, with the place of each value; and the refusal to make one.

Values only. Pure.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec

from srprov.errors import DefinitionError
from srprov.importing.position import Path, Position


class Refused(DefinitionError):
    """What Compose refuses, or srprov does; `problems` has each one with its place, message and hint."""


class Variable(msgspec.Struct, frozen=True):
    """One variable at one place that asks for it."""

    name: str
    source: str
    """Where the value comes from: `--set`, the name of an env file, `default` (written beside it) or `unset`."""
    value: str
    """What was put in; empty when it is unset."""
    at: Position


class Note(msgspec.Struct, frozen=True):
    """Something that is allowed and that the user should know."""

    at: Position
    message: str
    hint: str = ""


class Named(msgspec.Struct, frozen=True):
    """A file that was read because another one names it."""

    file: str
    """Its real path."""
    written: str
    at: Position


class Normal(msgspec.Struct, frozen=True):
    """One project: all files merged, variables put in, everything in its long form."""

    document: Mapping[str, Any]
    """What `docker compose config --format json` prints: name, services, networks, volumes, configs, secrets."""
    positions: Mapping[Path, Position]
    """Path in the document -> where it was written; paths without an entry stand where the nearest one above stands."""
    variables: tuple[Variable, ...] = ()
    warnings: tuple[Note, ...] = ()
    secret_files: frozenset[str] = frozenset()
    """Real paths of what any of the files calls a secret's file, also one that nothing in the document uses."""
    named_files: tuple[Named, ...] = ()
    """What was read for its variables, or as a Compose file; not what the user himself named."""
    home: str = ""
    """Real path of the folder of which each file may name what lies there; empty where that is what lies beside any."""

    def position_of(self, path: Path) -> Position:
        """Return where a value was written, or the nearest value around it."""
        for length in range(len(path), -1, -1):
            if found := self.positions.get(path[:length]):
                return found
        return Position("")
