"""Images of a run from the engines that have them, for its bundle: this machine's, or robots'.

Takes the robots and ids of images; reads configurations and layers into this machine's cache of layers, where each was
compared with its digest. Nothing is changed on any robot, but a spool that goes again where an engine's files cannot be
read.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import msgspec

from srprov.codes import Code
from srprov.controller import built_here
from srprov.controller import fleet as fleets
from srprov.controller.fleet import Fleet
from srprov.controller.trial_images import Ran
from srprov.definitions.model import Host, Inventory
from srprov.errors import TransportError, UsageError
from srprov.hashing import sha256_of
from srprov.layers import Image, read_config
from srprov.session import Session
from srprov.transport.blobs import Blob, Blobs
from srprov.transport.image_archive import ForeignImage
from srprov.transport.image_config import configuration
from srprov.transport.image_source import ImageSources
from srprov.transport.image_there import image_of, store_of
from srprov.untrusted import json_or_none

HERE = "this machine"
Say = Callable[[str], None]


class Read(msgspec.Struct, frozen=True, kw_only=True):
    """An image whose configuration and layers are in this machine's cache."""

    config: bytes
    documents: tuple[bytes, ...]
    """Configuration, manifests and indexes that were read."""
    layers: tuple[Blob, ...]
    """Each once, from the base up."""


@contextmanager
def own_engine(timeout_s: float) -> Iterator[Fleet]:
    """Connect to the engine of this machine."""
    here = Inventory(hosts={HERE: Host(name=HERE, address="localhost", connection="local")}, groups={"all": (HERE,)})
    with fleets.connect(here, timeout_s=timeout_s, forks=1) as found:
        yield found


class Engines:
    """Engines that may have images."""

    def __init__(self, fleet: Fleet, apart: Path, ran: Ran) -> None:
        """Take the robots, of which those out of reach are told of when an image is nowhere; and a folder that goes.

        `ran` is what this machine remembers of the run.
        """
        self._fleet, self._ran = fleet, ran
        self._sources, self._apart = ImageSources(), ImageSources(Blobs(apart))

    def read(self, image: str, words: str, first: Sequence[str], say: Say, names: Collection[str] = ()) -> Read:
        """Read an image.

        Which id a container's image has is the word of its robot, or of a stranger's folder, either of which may say
        that of another experiment's. So it is one that this machine remembers of the run, and comes from who had it
        there, also by way of the cache, which knows who gave what; or from an engine that has it under its name, and
        then all of it comes from there.

        Args:
            image: Its id, as an engine has it.
            words: It, in words.
            first: Robots that ran it; they are asked first.
            say: Is told how far it is.
            names: As the experiment names it.

        Raises:
            UsageError: No engine has it, or gives it; or srprov built another one under its name.
            OSError: There is no room for it here.
        """
        found = self._read(image, words, first, say, names)
        # what is no configuration goes into no bundle
        if about := read_config(f"sha256:{sha256_of(found.config)}", _json(found.config)):
            built_here.check(names, image, about, self._ran.counting(names), self._sources.blobs)
        return found

    def _read(self, image: str, words: str, first: Sequence[str], say: Say, names: Collection[str]) -> Read:
        """Read it from who had it, whatever it is."""
        had = self._ran.robots(image, names)
        if not had:
            hint = "bundle it on the machine that ran it, from the folder that it ran in; or --with-images none"
            raise UsageError(f"{words}: no run of this machine is known that had it", hint=hint, code=Code.IMAGE_COPY)
        if cached := next(filter(None, (self._cached(image, one) for one in sorted(had))), None):
            return cached
        why: dict[str, str] = {}
        robots = [one for one in first if one in self._fleet.inventory.hosts]
        robots += [one for one in sorted(self._fleet.inventory.hosts) if one not in robots]
        for name in robots:
            try:
                session = self._fleet.sessions.get(name)
                own = session.identity in had
                called = [image] if own else sorted(names)
                for found in filter(None, (image_of(session, one) for one in called)):
                    if found.id == image:
                        return self._from(session, found, words, say, self._sources if own else self._apart)
                why[name] = "it does not have it" + ("" if own else " under that name")
            except TransportError as error:
                why[name] = error.message
            except ForeignImage as error:
                why[name] = str(error)
        told = "; ".join(f"{name}: {one}" for name, one in sorted(why.items()))
        hint = "name the robots that ran it with -i, while they have it; or --with-images none"
        raise UsageError(f"{words} cannot be had: {told}", hint=hint, code=Code.IMAGE_COPY)

    def _cached(self, image: str, robot: str) -> Read | None:
        """Return an image of which all is in the cache already, and came from this robot."""
        blobs = self._sources.blobs
        if not blobs.givers.gave(image, robot) or (config := blobs.get(image)) is None:
            return None
        content = b"".join(config.content())
        found = read_config(image, _json(content))
        wanted = [*dict.fromkeys(found.diff_ids)] if found else []
        if not wanted or not all(blobs.givers.gave(one, robot) for one in wanted):
            return None
        layers = [blobs.get(one, lambda: True) for one in wanted]
        kept = tuple(one for one in layers if one is not None)
        return Read(config=content, documents=(content,), layers=kept) if len(kept) == len(layers) else None

    def _from(self, session: Session, image: Image, words: str, say: Say, sources: ImageSources) -> Read:
        classic = store_of(session) == "classic"
        documents: list[bytes] = []

        def fast() -> bool:
            return sources.links.gives_fast(session)

        with sources.source(session, image) as source:

            def small(digest: str) -> Blob:
                found = source.get(digest, f"{words}, configuration", say)
                documents.append(b"".join(found.content()))
                return found

            found, config = configuration(image, small, classic=classic)
            wanted = tuple(dict.fromkeys(found.diff_ids))
            layers = [
                source.get(one, f"{words}, layer {number} of {len(wanted)}", say, fast)
                for number, one in enumerate(wanted, start=1)
            ]
        return Read(config=b"".join(config.content()), documents=tuple(documents), layers=tuple(layers))


def _json(config: bytes) -> object:
    return json_or_none(config.decode("utf-8", "replace"))
