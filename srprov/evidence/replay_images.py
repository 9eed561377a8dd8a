"""The images of a bundle for a replay: into this machine's cache, and which service has which.

The bundle was verified before; what is kept is compared once more, each with its digest.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator, Mapping

import msgspec

from srprov.codes import Code
from srprov.controller.kept_images import Content, keep
from srprov.controller.request import BundledImage
from srprov.errors import UsageError
from srprov.evidence import story
from srprov.evidence.files import Files
from srprov.evidence.images import LAYOUT, NAME, stored
from srprov.evidence.story import Story
from srprov.evidence.verified import Bundle, reopened
from srprov.facts.model import Snapshot
from srprov.image_reference import BUILT
from srprov.oci.layout import Stored, blob

_BY_ITS_WORD = "built of its CDF by the bundle's word; --no-bundled-images builds it here"


class Kept(msgspec.Struct, frozen=True, kw_only=True):
    """What a replay has of a bundle's images."""

    images: Mapping[str, tuple[BundledImage, ...]]
    """Service -> its own image; of what srprov built, also those of the same name for other architectures."""
    names: Mapping[str, str]
    """Service -> its image as the bundle's run named it, of all services."""
    built: frozenset[str] = frozenset()
    """Services whose CDF is built, by the definitions: the run may name their images as it likes."""


def bring(bundle: Bundle, say: Callable[[str], None], *, wanted: bool = True) -> Kept:
    """Bring the images of a bundle into this machine's cache.

    Args:
        bundle: It, as it was verified.
        say: Is told how far it is.
        wanted: Without it, they stay where they are.

    Raises:
        UsageError: The bundle cannot be read, or there is no room.
    """
    try:
        with reopened(bundle) as files, story.read(files) as told:
            names = {service: _called(name) for service, (name, _) in told.images.items()}
            every = stored(files) if wanted else ()
            keep(_contents(files, every), say)
            return Kept(images=dict(_of_services(told, every)), names=names, built=frozenset(_built(told)))
    except ValueError as error:
        hint = f"srprov verify {shlex.quote(str(bundle.path))} says more"
        raise UsageError(f"the images of {bundle.path} cannot be read: {error}", hint=hint, code=Code.REPLAY) from error


def _built(told: Story) -> Iterator[str]:
    containers = told.definitions.containers
    for service, one in told.last.choice.experiment.services.items():
        if not one.image and (cdf := containers.get(one.cdf)) and not cdf.image:
            yield service


def _called(name: str) -> str:
    """Return what an image is called for a line of the plan: a journal may have any text there, and of any length."""
    return name if NAME.fullmatch(name) else "image, which it calls as no image is called"


def _contents(files: Files, every: tuple[Stored, ...]) -> Iterator[Content]:
    seen = set[str]()
    for one in every:
        parts = [(one.id, one.id, len(one.config), False)]
        parts += [(layer.diff_id, layer.digest, layer.size, True) for layer in one.layers]
        for digest, place, size, packed in parts:
            if digest not in seen:
                seen.add(digest)
                name = LAYOUT + blob(place)
                yield Content(digest, size, lambda name=name: files.pieces(name), packed)  # type: ignore[misc]


def _of_services(told: Story, every: tuple[Stored, ...]) -> Iterator[tuple[str, tuple[BundledImage, ...]]]:
    by_id = {id_: one for one in every for id_ in one.engine_ids}
    for service, (name, id_) in told.images.items():
        # what srprov did not build, a robot had; it says what its own services had, and no others
        built = name.startswith(BUILT)
        alike = [one for one in every if built and name in one.names and by_id.get(id_) is not one]
        own = [by_id[id_]] if id_ in by_id else []
        if found := tuple(BundledImage(one.id, one.architecture) for one in (*own, *alike)):
            yield service, found


def in_words(kept: Kept, snapshot: Snapshot, placed: Mapping[str, str]) -> Iterator[str]:
    """Return a line for each service: where its image comes from.

    Args:
        kept: What there is.
        snapshot: The robots as they are.
        placed: Service -> robot.
    """
    for service, name in sorted(kept.names.items()):
        facts = snapshot.facts.get(placed.get(service, ""))
        some = kept.images.get(service, ())
        fits = [one for one in some if not facts or not one.architecture or one.architecture in facts.runs]
        if fits:
            # which image a registry, or somebody, gave under a name is the word of the robot that had it; and what was
            # built under a tag that of who made the bundle: nothing in an image says of which definitions it was built
            had = f"as its {placed.get(service, 'robot')} had it"
            whose = f", {_BY_ITS_WORD if service in kept.built else had}"
            yield f"{service}: the bundle's {name}, {fits[0].id[7:19]}{whose}"
        else:
            yield f"{service}: {_elsewhere(name, built=service in kept.built)}" + (
                ", as the bundle's is for another architecture" if some else ""
            )


def _elsewhere(name: str, *, built: bool) -> str:
    if built:
        return f"{name}, built again where no robot has it: packages may be others by now"
    if "@sha256:" in name:
        return f"{name}, by its digest"
    return f"{name}, by its name: it may be another image today"
