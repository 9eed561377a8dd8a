"""An image goes from one robot's engine to another's over the controller: the layers that are missing there, or whole.

Thin: both engines find layers by chain id, so what the target has is not sent; the rest comes from this machine's cache
or is read from the source once for all. Registry: an engine with a containerd store does the same when it pulls
(`registry_copy.py`). Whole: `docker save | docker load`, in pieces. After each, what the target has is compared with
what the source has: an engine says 200 before it fails.

Who names a layer need not have it. One that the target has, of whatever image, is asked of the source all the same,
once: else a builder that lies would make an image of what another experiment has there, which others get from there.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

from msgspec.structs import replace

from srprov.errors import TransportError
from srprov.layers import Image, foreign
from srprov.session import Progress, Reader, Session
from srprov.transport.blob import Blob
from srprov.transport.givers import Givers
from srprov.transport.image_archive import ForeignImage, Wanted, only
from srprov.transport.image_config import configuration
from srprov.transport.image_deliver import deliver
from srprov.transport.image_progress import Meter, mib
from srprov.transport.image_there import Room, Target, image_of, look_at, store_of
from srprov.transport.registry_copy import NoWayBack, copy_by_registry
from srprov.transport.thin_archive import ThinArchive
from srprov.wire import CopyImage, Reply

if TYPE_CHECKING:
    from srprov.transport.options import ConnectOptions, Peers
    from srprov.transport.session import BaseSession

_FULL = "no space left on device"


class NotThin(Exception):
    """It cannot go without the layers that are there; the text says why."""


def copy_image(
    copy: CopyImage, session: BaseSession, peers: Peers | None, options: ConnectOptions, progress: Progress
) -> Reply:
    """Bring an image from another robot; one piece of it is in memory at a time.

    One that the source did not build in this run has the id that the copy names, or is not loaded.

    Raises:
        TransportError: This robot cannot be talked to any more; that of the source is a reply.
    """
    if peers is None:
        return _failed(f"no way to {copy.source_host} from here")
    ids, sent = (copy.id,) if copy.id else (), "sent whole"
    try:
        source = peers(copy.source_host)
        if copy.way != "whole":
            try:
                return _Thin(copy, session, source, options, progress).run(ids)
            except NotThin as error:
                if copy.way == "thin":
                    return _failed(f"it cannot be sent without the layers that are there: {error}")
                progress(f"{copy.image} is sent whole: {error}")
                sent = f"sent whole, as {error}"
        reply = _whole(copy, session, source, ids, options.image_sources.blobs.givers, progress)
        return replace(reply, out=sent) if reply.ok else reply
    except ForeignImage as error:
        return _failed(f"{copy.source_host}: {error}")
    except TransportError as error:
        if error.host == session.host:
            raise
        return _failed(f"{error.host}: {error.message}")


def _check_architecture(image: Image, copy: CopyImage) -> None:
    """Refuse an image that the robot would not run, whatever its tag."""
    if why := foreign(image.architecture, copy.runs):
        raise ForeignImage(f"{copy.image}: {why}")


def _failed(why: str) -> Reply:
    return Reply(status=0, ok=False, err=why)


class _Thin:
    """One copy of the missing layers."""

    def __init__(
        self, copy: CopyImage, session: BaseSession, source: Session, options: ConnectOptions, progress: Progress
    ) -> None:
        self._copy, self._session, self._source, self._progress = copy, session, source, progress
        self._sources = options.image_sources

    def run(self, ids: Collection[str]) -> Reply:
        """Do it.

        Raises:
            NotThin: The image has to be sent whole.
            ForeignImage: The source has another image.
        """
        image, store = image_of(self._source, self._copy.image), store_of(self._source)
        if image is None or not store:
            raise NotThin(f"the engine of {self._source.host} does not say what it has")
        if ids and image.id not in ids:
            raise ForeignImage(f"it gives another image under {self._copy.image} than the one that was built")
        _check_architecture(image, self._copy)
        target = look_at(self._session)
        every = tuple(dict.fromkeys(image.diff_ids))
        if self._copy.way == "registry" or (target.containerd and not self._copy.way):
            return self._pull(self._archive(image, store, every, every), target)
        if not target.classic:
            raise NotThin(f"the engine of {self._session.host} has no classic store")
        missing = target.missing(image)
        unproved = _unproved(self._copy, image, self._session, self._source, self._sources.blobs.givers)
        read = tuple(one for one in every if one in missing or one in unproved)
        return self._load(self._archive(image, store, read, missing), target.room)

    def _archive(self, image: Image, store: str, read: Collection[str], sent: Collection[str]) -> ThinArchive:
        """Get layers from the source, or from the cache, and make an archive of those that are to be sent."""
        name, links = self._copy.image, self._sources.links

        def fast() -> bool:
            return links.gives_fast(self._source) and links.takes_fast(self._session)

        try:
            with self._sources.source(self._source, image) as source:

                def small(digest: str) -> Blob:
                    return source.get(digest, f"{name}, configuration", self._progress)

                image, config = configuration(image, small, classic=store == "classic")
                _check_architecture(image, self._copy)
                layers = {
                    one: source.get(one, f"{name}, layer {number} of {len(read)}", self._progress, fast)
                    for number, one in enumerate(read, 1)
                }
        except ForeignImage as error:
            if store == "classic":
                raise
            # its archive may lack layers that it never fetched; whole, the engine says for itself what it needs
            raise NotThin(f"{self._source.host}: {error}") from error
        except OSError as error:
            raise NotThin(f"the cache of layers cannot be used: {error.strerror or error}") from error
        return ThinArchive(image, name, config, [layers[one] for one in sent])

    def _pull(self, archive: ThinArchive, target: Target) -> Reply:
        """Let the engine pull it; it compares by itself."""
        try:
            return copy_by_registry(archive, target, self._session, self._copy.timeout_s, self._progress)
        except NoWayBack as error:
            raise NotThin(str(error)) from error
        except OSError as error:
            raise NotThin(f"the cache of layers cannot be read: {error.strerror or error}") from error

    def _load(self, archive: ThinArchive, room: Room) -> Reply:
        """Send it and compare what is there then."""
        image, words = archive.image, f"{len(archive.layers)} of {len(archive.image.diff_ids)} layers"
        what = f"{archive.tag}, {words}"
        try:
            reply = deliver(
                archive, self._session, room, self._sources.links, self._copy.timeout_s, what, self._progress
            )
        except OSError as error:
            raise NotThin(f"the cache of layers cannot be read: {error.strerror or error}") from error
        if not reply.ok and (not reply.status or _FULL in reply.err.lower()):
            return reply
        if not reply.ok:
            raise NotThin(f"its engine did not take it: {reply.err}")
        if image_of(self._session, archive.tag) != image:
            raise NotThin("its engine has another image now than the one that was sent")
        return Reply(status=reply.status, out=f"sent {words}, {mib(archive.size)} MiB")


def _unproved(copy: CopyImage, image: Image, session: Reader, source: Session, givers: Givers) -> frozenset[str]:
    """Return the layers of an image that the source never gave: it may only have named them.

    Those of the image that it was built on, as the robot has that, were named by its definition.
    """
    found = image_of(session, copy.base) if copy.base else None
    below = found.diff_ids if found and image.diff_ids[: len(found.diff_ids)] == found.diff_ids else ()
    return frozenset(one for one in {*image.diff_ids} - {*below} if not givers.gave(one, source.identity))


def _whole(
    copy: CopyImage, session: BaseSession, source: Session, ids: Collection[str], givers: Givers, progress: Progress
) -> Reply:
    """Load the image while the other robot saves it."""
    image = image_of(source, copy.image)
    if image is None:
        raise ForeignImage(f"its engine does not say what {copy.image} is")
    _check_architecture(image, copy)
    # also those that the robot does not seem to have: its engine keeps layers that no image lists, and gets new ones
    wanted = Wanted(image, _unproved(copy, image, session, source, givers))
    chunks = source.save_image(copy.image, copy.timeout_s)
    pieces = Meter(copy.image, progress).count(only(chunks, copy.image, ids, wanted))
    reply = session.engine.client.load(pieces, copy.timeout_s, progress)
    if not reply.ok:
        return reply
    for one in wanted.unproved:
        givers.note(one, source.identity)
    there = image_of(session, copy.image)
    # stores count ids differently, but layers alike
    if there is None or there.diff_ids != image.diff_ids:
        return _failed(f"its engine does not have what {copy.source_host} has, although it said nothing")
    return reply
