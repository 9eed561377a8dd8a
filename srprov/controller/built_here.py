"""Which images count as those that srprov built for a run, whatever robots have under their tags.

A robot that got a copy of an image may have another one under the tag by now, of its own making. A plan takes it for
nobody else; a bundle would bring it to all who run it again. So a run remembers which images count for others, as a
plan has it (`image_builders.py`), and a bundle holds no other one under such a name.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

from srprov.codes import Code
from srprov.controller.image_builders import counted
from srprov.controller.plan import Planned
from srprov.definitions.model import BUILDERS, Inventory
from srprov.errors import UsageError
from srprov.facts.model import native
from srprov.image_reference import BUILT, BUNDLED, bundled_name
from srprov.layers import Image
from srprov.record.memory import built_for, known_images
from srprov.session import Session
from srprov.transport import on_record
from srprov.transport.blobs import Blob, Blobs
from srprov.transport.image_archive import ForeignImage
from srprov.transport.image_config import configuration


def counting(planned: Planned, inventory: Inventory, sessions: Mapping[str, Session]) -> dict[str, set[str]]:
    """Return what `built_for` says of a plan's tags -> ids of the images that others may have.

    Those that this machine had built on robots that would build them now, and those that builders have.
    """
    snapshot, tags = planned.snapshot, planned.images.keys()
    if snapshot is None or not tags:
        return {}

    def proofs(robot: str) -> Collection[str]:
        if robot in sessions:
            return (sessions[robot].identity,)
        return on_record(inventory.hosts[robot]) if robot in inventory.hosts else ()

    builders = inventory.groups.get(BUILDERS, ())
    found = {key: {*ids} for key, ids in counted(known_images(), tags, builders, snapshot, proofs).items()}
    for robot in snapshot.facts.keys() & {*builders}:
        arch = snapshot.facts[robot].arch
        for one in snapshot.observed.get(robot, ()):
            if one.module == "image" and one.name in tags:
                found[built_for(one.name, arch)].add(str(one.state["id"]))
    return found


def check(names: Collection[str], engine_id: str, config: Image, known: Mapping[str, Mapping[str, Collection[str]]],
          blobs: Blobs) -> None:  # fmt: skip
    """Refuse an image that has a name of srprov's, and is not the one that was built under it.

    Args:
        names: As the run names it.
        engine_id: By which the engine that gave it knows it; its content was compared with that.
        config: It, by its configuration.
        known: Content tag -> architecture of who built it -> ids that count.
        blobs: May have what leads from another engine's id to its configuration.

    Raises:
        UsageError: It is another one.
    """
    for name in sorted(one for one in names if one.startswith(BUILT)):
        if name.startswith(BUNDLED):
            right = name == bundled_name(config.id)
        else:
            some = [ids for arch, ids in known.get(name, {}).items() if config.architecture in native(arch)]
            ids = {one for each in some for one in each}
            right = not ids.isdisjoint({engine_id, config.id}) or any(_leads(one, config, blobs) for one in ids)
        if not right:
            raise UsageError(
                f"{name}: the run had {engine_id.removeprefix('sha256:')[:12]} under that name, which is not the image "
                "that was built: whoever ran it may have made it",
                hint="remove it there, and run the trials again; or --with-images none",
                code=Code.IMAGE_COPY,
            )


def _leads(engine_id: str, config: Image, blobs: Blobs) -> bool:
    """Return whether an id that another kind of store has leads to a configuration, by what is in the cache."""

    def get(digest: str) -> Blob:
        if (blob := blobs.get(digest)) is None:
            raise ForeignImage(f"{digest} is not here")
        return blob

    try:
        found, _ = configuration(Image(engine_id, config.diff_ids), get, classic=False)
    except (ForeignImage, OSError, ValueError):
        return False
    return found.id == config.id
