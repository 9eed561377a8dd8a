"""How much may be read of all files that belong together: a small file may name a thousand large ones.

Takes limits; whoever reads inside of the block, at whatever depth, counts against them. What was found of folders that
are named, maybe a thousand times each, is kept with them, and so is what was read, or may not be. Touches nothing else.
"""

from __future__ import annotations

import builtins
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import NamedTuple

from srprov.errors import Diagnostic


class Left(NamedTuple):
    """A file or folder that was named, and not looked at."""

    path: str
    whose: str
    """The service that named it, or nothing."""
    note: Diagnostic


@dataclass
class Allowance:
    """How much may still be read: bytes of text, and values of documents."""

    bytes: int
    values: int
    most_bytes: int = 0
    """Of all files together, for messages."""
    files: int = 50_000
    """In folders that are walked through: so many may be shipped (`disk.py`)."""
    walked: dict[tuple[str, str], str] = field(default_factory=dict)
    """Folder, and what no link in it may leave -> what is wrong with it."""
    names: dict[str, Counter[tuple[int, int]]] = field(default_factory=dict)
    """Folder -> files in it that have several names, as the kernel knows them, and how many of these are there."""
    contents: dict[str, builtins.bytes] = field(default_factory=dict)
    """Path -> what was read there: whoever needs it later must not read what others put there since."""
    homes: list[str] = field(default_factory=list)
    """Folders whose own files alone may be looked at; where there is none, all files may."""
    left: list[Left] = field(default_factory=list)
    """What therefore was not looked at."""


current: ContextVar[Allowance | None] = ContextVar("current", default=None)


@contextmanager
def allowance(most_bytes: int, most_values: int, home: str = "") -> Iterator[Allowance]:
    """Limit all that is read in the block, together. Inside of another block, that one's limits go on.

    With `home`, a folder, no file is looked at but its own.
    """
    limits = current.get() or Allowance(most_bytes, most_values, most_bytes, homes=[home] if home else [])
    token = current.set(limits)
    try:
        yield limits
    finally:
        current.reset(token)
