"""Which images of those that this machine had built count for others now: those of a robot that would build them now.

Who builds is the choice of one inventory: a host of its group `builders`, or the first robot where there is no such
group. Where there is one, and none of it is in reach, each robot builds for itself: whoever names builders trusts no
other one with it. A robot that was alone built for itself; where another inventory, or another laboratory's, names
builders, it is none of them. Pure, but for what asks who a robot is.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection, Iterator, Mapping

from srprov.codes import Code
from srprov.definitions.model import BUILDERS, Inventory
from srprov.errors import RefusedError
from srprov.facts.gather import Gathering
from srprov.facts.model import Snapshot
from srprov.modules.image import ImageParams
from srprov.record.memory import built_for
from srprov.resource import Resource
from srprov.transport import on_record


def alike(snapshot: Snapshot, arch: str) -> set[str]:
    """Return the robots in reach of an architecture that have an engine: each could build for the others."""
    return {name for name, one in snapshot.facts.items() if one.arch == arch and one.docker is not None}


def counted(
    known: Mapping[str, Collection[str]], tags: Collection[str], builders: Collection[str], snapshot: Snapshot,
    proofs: Callable[[str], Collection[str]],
) -> dict[str, frozenset[str]]:  # fmt: skip
    """Return what `built_for` says of tags -> ids of images that count.

    Args:
        known: What this machine remembers; see `record.memory.known_images`.
        tags: Content tags.
        builders: The hosts of the inventory's group.
        snapshot: The robots as they are.
        proofs: Tells what a robot proves to be, or of one that is away what it could: each laboratory may have a
            robot1. What one that is away built may come from others, or it would be built again.
    """
    found = {}
    for arch in sorted({one.arch for one in snapshot.facts.values()}):
        here, chosen = _builders(arch, builders, snapshot)
        away = snapshot.unreachable.keys() & (builders if chosen else snapshot.unreachable)
        for key in (built_for(tag, arch) for tag in tags):
            built = (entry.partition(" ")[::2] for entry in known.get(key, ()))
            found[key] = frozenset(id_ for id_, who in built if _would_build(who, here | away, proofs))
    return found


def _builders(arch: str, builders: Collection[str], snapshot: Snapshot) -> tuple[set[str], bool]:
    """Return the robots in reach that build for others of an architecture, and whether the inventory's group says so.

    Which architecture a robot is of is its own word, and a builder may be away: neither makes another one a builder.
    """
    every, chosen = alike(snapshot, arch), bool(builders)
    return (every.intersection(builders) if chosen else every), chosen


def check_builders(steps: Collection[Resource], inventory: Inventory, snapshot: Snapshot) -> None:
    """Refuse a plan, which was not written here, that has images built elsewhere than this inventory would have them.

    A tag is all that says what an image is: whoever builds under it decides what others run who have it, too, the
    user's own experiments among them. `steps` are what its steps want.

    Raises:
        RefusedError: Names the images, and who would build them.
    """
    if strange := sorted(set(_strange_builds(steps, inventory, snapshot))):
        raise RefusedError(
            "only this plan, which was not written here, says who builds: "
            + ", ".join(f"{name} on {robot}" for name, robot in strange),
            hint=f"plan its EDF here: a host of the inventory's group '{BUILDERS}' builds, or the first robot",
            code=Code.STRANGE_PLAN,
        )


def _strange_builds(steps: Collection[Resource], inventory: Inventory, snapshot: Snapshot) -> Iterator[tuple[str, str]]:
    """Yield image and builder of each that is built, or copied from its builder, where this inventory would not."""
    builders = inventory.groups.get(BUILDERS, ())
    # one that was not asked may be of any architecture
    unasked = inventory.hosts.keys() - snapshot.facts.keys() - snapshot.unreachable.keys()
    for want in steps:
        facts, params = snapshot.facts.get(want.host), want.params
        if facts is None or not isinstance(params, ImageParams):
            continue  # nothing is done on a robot that is out of reach
        made = params.source == "build"
        if not made and (params.source != "copy" or params.id):
            continue
        builder = want.host if made else params.from_
        here, chosen = _builders(facts.arch, builders, snapshot)
        lack = {one for one in here if not _has(one, want.name, snapshot)}
        right = builder in here and (chosen or builder == min(lack | unasked, default=""))
        right = right or (made and chosen and not (here or unasked))  # for itself alone, as no builder is in reach
        # a build is remembered as one for what it says that its robot runs
        if not right or (made and params.runs[:1] not in ((), facts.runs[:1])):
            yield want.name, builder


def _has(robot: str, image: str, snapshot: Snapshot) -> bool:
    return any(one.module == "image" and one.name == image for one in snapshot.observed[robot])


def _would_build(who: str, builders: Collection[str], proofs: Callable[[str], Collection[str]]) -> bool:
    name = who.partition(" ")[0]
    return name in builders and who in proofs(name)


def proofs_of(look: Gathering, snapshot: Snapshot) -> Callable[[str], Collection[str]]:
    """Return what tells who a robot proves to be; of one that is away, by the host keys that are on record for it."""

    @functools.cache  # many images may be of one builder, and what is on record is read from files
    def of(robot: str) -> Collection[str]:
        host = look.inventory.hosts.get(robot)
        if robot in snapshot.unreachable:
            return on_record(host) if host else ()
        return (look.identity(robot),)

    return of
