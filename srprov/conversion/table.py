"""The one table of what becomes of each key of the Compose specification: conversion, reports and docs go by it. Pure.

Tests hold it to the JSON schema of Compose 2.40.3: each key has a row, or lies below one that speaks for all below it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import msgspec

from srprov.conversion.kept import Kept, Row
from srprov.conversion.table_parts import GRANTED, MOUNTS, NETWORK, ORDER
from srprov.conversion.table_rest import BUILD, DEPLOY, TOP
from srprov.conversion.table_service import SERVICE
from srprov.importing.position import Path

VERSION = "2.40.3"
"""Of Docker Compose, whose schema was read."""

TABLE: Mapping[str, Row] = {
    row.path: row for row in (*TOP, *SERVICE, *MOUNTS, *NETWORK, *ORDER, *GRANTED, *BUILD, *DEPLOY)
}

_NAMED = ("services", "networks", "volumes", "secrets", "configs")
_NAMED_BELOW = ("networks", "depends_on")
"""Keys of a service below which users choose names."""


def row_of(key: str) -> Row | None:
    """Return the row of a key, its own or one above that speaks for all below it; None: nobody knows it."""
    if key in TABLE:
        return TABLE[key]
    while "." in key:
        key = key.rpartition(".")[0]
        if key in TABLE:
            return TABLE[key] if TABLE[key].whole else None
    return None


def key_of(path: Path) -> str:
    """Return the key that a place in a project belongs to."""
    words = [str(part) for part in path if isinstance(part, str)]
    if len(words) > 1 and words[0] in _NAMED:
        words[1] = "*"
    if len(words) > 3 and words[0] == "services" and words[2] in _NAMED_BELOW:
        words[3] = "*"
    return ".".join(words)


class Present(msgspec.Struct, frozen=True):
    """One key of a project that was read."""

    path: Path
    row: Row | None
    """None: nobody knows the key."""
    value: object
    holds: bool
    """It has keys of its own, of which each is told by itself."""


def present(document: Mapping[str, Any]) -> Iterator[Present]:
    """Yield each key of a project, down to where the table tells parts apart."""
    for key, value in document.items():
        if not key.startswith("x-"):
            yield from _below((key,), value)


def _below(path: Path, value: object) -> Iterator[Present]:
    key = key_of(path)
    row = row_of(key)
    named = row is None and key.endswith(".*")
    parts = named or (key in _PARENTS and not (row and row.whole))
    below = list(_parts(path, value)) if parts else []
    if not named:
        yield Present(path, row, value, bool(below))
    for inner, item in below:
        yield from _below(inner, item)


def _parts(path: Path, value: object) -> Iterator[tuple[Path, object]]:
    """Yield the keys of a map, or of the maps in a list."""
    if isinstance(value, Mapping):
        yield from (((*path, str(name)), item) for name, item in value.items() if not str(name).startswith("x-"))
    for index, one in enumerate(value if isinstance(value, list) else ()):
        yield from _parts((*path, index), one)


_PARENTS = frozenset(key.removesuffix(".*") for row in TABLE for key in (row.rpartition(".")[0],) if key)
"""Keys of which the table tells parts apart."""


def kinds(row: Row) -> frozenset[Kept]:
    """Return every class that something at a row may be in."""
    return frozenset({row.kept, *(kept for kept, _ in row.but)})
