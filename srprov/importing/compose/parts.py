"""Which files say something of a thing that has a name: a service, a volume, a config or a secret. Pure.

Noted as each file is laid over those before it, so that what a file takes away (`!reset`) counts, too; the places of
values that are left say nothing of that.
"""

from __future__ import annotations

from srprov.importing.compose.values import Value
from srprov.importing.normal import Part
from srprov.importing.position import Path

KINDS = ("services", "volumes", "configs", "secrets")
SETTINGS = "x-srprov"
"""Of an export: says how all services find each other."""


def note(own: Value, before: Value, parts: dict[Path, list[Part]]) -> None:
    """Note what a file, as it is written, says of each thing; `before` is what it is laid over."""
    for kind in (*KINDS, SETTINGS):
        given = own.get(kind)
        if given is None:
            if own.tag:
                _taken_away(own, kind, before, parts)
            continue
        if given.tag:
            _taken_away(given, kind, before, parts)
        if kind == SETTINGS:
            parts.setdefault((SETTINGS,), []).append(Part(given.place))
        elif isinstance(given.data, dict):
            for name, one in given.data.items():
                keys = tuple(one.data) if isinstance(one.data, dict) else ()
                parts.setdefault((kind, name), []).append(Part(one.place, keys))


def _taken_away(value: Value, kind: str, before: Value, parts: dict[Path, list[Part]]) -> None:
    """Note that a file takes away, or replaces, all things of one kind."""
    have = before.get(kind)
    for name in have.data if have is not None and isinstance(have.data, dict) else ():
        parts.setdefault((kind, name), []).append(Part(value.place, (value.tag,)))
