"""An image goes from this machine's cache of layers to a robot's engine: the layers that are missing there, or whole.

What is in the cache was compared with its digests when it came, so that an image named by the digest of its
configuration is that image or none. After each way, what the robot has is compared with it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from srprov.layers import Image, foreign, read_config
from srprov.session import Progress
from srprov.transport.blob import Blob
from srprov.transport.blobs import Blobs
from srprov.transport.image_archive import ForeignImage
from srprov.transport.image_deliver import deliver
from srprov.transport.image_progress import Meter, mib
from srprov.transport.image_there import Room, image_of, look_at
from srprov.transport.registry_copy import NoWayBack, copy_by_registry
from srprov.transport.thin_archive import ThinArchive
from srprov.untrusted import json_or_none
from srprov.wire import CopyImage, Reply

_FULL = "no space left on device"
if TYPE_CHECKING:
    from collections.abc import Collection

    from srprov.transport.options import ConnectOptions
    from srprov.transport.session import BaseSession


def load_image(copy: CopyImage, session: BaseSession, options: ConnectOptions, progress: Progress) -> Reply:
    """Bring an image from the cache of layers; one piece of it is in memory at a time.

    Args:
        copy: Names it by the digest of its configuration.
        session: The robot.
        options: Have the cache, and what is known of links.
        progress: Is told how far it is.

    Raises:
        TransportError: The robot cannot be talked to any more.
    """
    try:
        return _Loading(copy, session, options, progress).run()
    except ForeignImage as error:
        return _failed(str(error))
    except OSError as error:
        return _failed(f"the cache of layers cannot be read: {error.strerror or error}")


def _failed(why: str) -> Reply:
    return Reply(status=0, ok=False, err=why)


class _Loading:
    """One image on its way."""

    def __init__(self, copy: CopyImage, session: BaseSession, options: ConnectOptions, progress: Progress) -> None:
        self._copy, self._session, self._progress = copy, session, progress
        self._links = options.image_sources.links
        self._blobs: Blobs = options.image_sources.blobs
        self._home = options.home

    def run(self) -> Reply:
        """Do it."""
        copy = self._copy
        config = self._blob(copy.id)
        said = b"".join(config.content()).decode("utf-8", "replace")
        image = read_config(copy.id, json_or_none(said))
        if image is None:
            raise ForeignImage(f"{copy.id} is the configuration of no image")
        if why := foreign(image.architecture, copy.runs):
            raise ForeignImage(f"{copy.image}: {why}")
        every = tuple(dict.fromkeys(image.diff_ids))
        target = look_at(self._session)
        if copy.way == "registry" or (target.containerd and not copy.way):
            archive = self._archive(image, config, every)
            try:
                return copy_by_registry(archive, target, self._session, copy.timeout_s, self._progress)
            except NoWayBack as error:
                if copy.way:
                    return _failed(str(error))
                self._progress(f"{copy.image} is sent whole: {error}")
        if target.classic and copy.way != "whole":
            reply = self._thin(self._archive(image, config, target.missing(image)), target.room)
            if reply.ok or copy.way or not reply.status or _FULL in reply.err.lower():
                return reply
            self._progress(f"{copy.image} is sent whole: {reply.err}")
        archive = self._archive(image, config, every)
        pieces = Meter(copy.image, self._progress, archive.size).count(archive.pieces())
        return self._compared(self._session.engine.client.load(pieces, copy.timeout_s, self._progress), archive)

    def _thin(self, archive: ThinArchive, room: Room) -> Reply:
        """Send what is missing."""
        what = f"{archive.tag}, {_words(archive)}"
        timeout_s = self._copy.timeout_s
        reply = deliver(archive, self._session, room, self._links, timeout_s, what, self._progress)
        return self._compared(reply, archive)

    def _archive(self, image: Image, config: Blob, layers: Collection[str]) -> ThinArchive:
        return ThinArchive(image, self._copy.image, config, [self._blob(one) for one in layers])

    def _blob(self, digest: str) -> Blob:
        fast = self._links.takes_fast
        with self._blobs.turn(digest):
            found = self._blobs.get(digest, lambda: fast(self._session))
            if found is None and self._home is not None:
                found = self._home.layer(digest)
        if found is None:
            raise ForeignImage(f"{digest} is not in this machine's cache of layers any more")
        return found

    def _compared(self, reply: Reply, archive: ThinArchive) -> Reply:
        """Return the reply if the robot has the image now: an engine says 200 before it fails."""
        if not reply.ok:
            return reply
        there = image_of(self._session, archive.tag)
        if there is None or there.diff_ids != archive.image.diff_ids:
            return Reply(status=1, ok=False, err="its engine does not have what was sent, although it said nothing")
        return Reply(status=reply.status, out=f"sent {_words(archive)}, {mib(archive.size)} MiB")


def _words(archive: ThinArchive) -> str:
    return f"{len(archive.layers)} of {len(archive.image.diff_ids)} layers"
