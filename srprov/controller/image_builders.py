"""Which images of those that this machine had built count for others now: those of a robot that would build them now.

Who builds is the choice of one inventory: a host of its group `builders`, or else the first robot. A robot that was
alone built for itself; where another inventory, or another laboratory's, names builders, it is none of them. Pure, but
for what asks who a robot is.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping

from srprov.facts.model import Snapshot
from srprov.record.memory import built_for

BUILDERS = "builders"
"""The group of an inventory whose hosts build images."""


def alike(snapshot: Snapshot, arch: str) -> set[str]:
    """Return the robots in reach of an architecture that have an engine: each could build for the others."""
    return {name for name, one in snapshot.facts.items() if one.arch == arch and one.docker is not None}


def counted(
    known: Mapping[str, Collection[str]], tags: Collection[str], builders: Collection[str], snapshot: Snapshot,
    identity: Callable[[str], str],
) -> dict[str, frozenset[str]]:  # fmt: skip
    """Return what `built_for` says of tags -> ids of images that count.

    Args:
        known: What this machine remembers; see `record.memory.known_images`.
        tags: Content tags.
        builders: The hosts of the inventory's group.
        snapshot: The robots as they are.
        identity: Tells what a robot proves to be: each laboratory may have a robot1. One that is away proves nothing
            and goes by its name, or what it built could come from nobody.
    """
    found = {}
    # for a plan file its own robots alone are asked
    unasked = {*builders} - snapshot.facts.keys() - snapshot.unreachable.keys()
    for arch in sorted({one.arch for one in snapshot.facts.values()}):
        every = alike(snapshot, arch)
        named = every.intersection(builders)
        here = named if named or unasked else every
        away = snapshot.unreachable.keys() & (builders if named or unasked else snapshot.unreachable)
        for key in (built_for(tag, arch) for tag in tags):
            built = (entry.partition(" ")[::2] for entry in known.get(key, ()))
            found[key] = frozenset(id_ for id_, who in built if _would_build(who, here, away, identity))
    return found


def _would_build(who: str, here: Collection[str], away: Collection[str], identity: Callable[[str], str]) -> bool:
    name = who.partition(" ")[0]
    return name in away or (name in here and identity(name) == who)
