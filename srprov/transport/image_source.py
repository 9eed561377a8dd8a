"""Layers of an image come from the robot that has it into this machine's cache, each once for all that want it.

Only what the cache lacks is read, from the files of the engine where that can be (`layer_files.py`). Else `docker save`
is unpacked into a spool below `/var/lib/srprov`, which a shell of its own holds and removes when it ends, and read from
there, compressed by the robot. The bytes are compared with the digests that the image names, so that it does not matter
who could write to the spool.
"""

from __future__ import annotations

import contextlib
import posixpath
import threading
from collections.abc import Callable, Iterator
from itertools import chain

from srprov.layers import Image, config_name
from srprov.session import Progress, Session, Streams
from srprov.spool import read_script, save_script
from srprov.transport.blobs import Blob, Blobs, WrongBlob
from srprov.transport.image_archive import ForeignImage
from srprov.transport.image_progress import Meter
from srprov.transport.image_shell import answer, dismiss, output
from srprov.transport.layer_files import LayerFiles, NotInFiles
from srprov.transport.link_rate import Links
from srprov.transport.tar_stream import TarError, TarStream
from srprov.untrusted import json_or_none, mappings, string
from srprov.wire import Query

_SAVE_S = 1800.0
_GZIP = b"\x1f\x8b"
_LAYOUT = "blobs/sha256/"
"""Where everything is in an OCI layout, by its hash."""


class NoSpool(Exception):
    """The robot cannot unpack an image for itself; the text says why."""


class ImageSources:
    """What is being read from robots, shared by all sessions of a run. Safe for several threads."""

    def __init__(self, blobs: Blobs | None = None) -> None:
        """Take the cache; None: the user's own."""
        self.blobs = blobs or Blobs()
        self._lock = threading.Lock()
        self._open: dict[tuple[str, str], _Source] = {}
        self._users: dict[tuple[str, str], int] = {}
        self.links = Links()
        """How fast the robots' are."""

    @contextlib.contextmanager
    def source(self, session: Session, image: Image) -> Iterator[_Source]:
        """Give what reads an image from a robot; its spool goes with the last who uses it."""
        key = session.host, image.id
        with self._lock:
            source = self._open.setdefault(key, _Source(session, image, self.blobs))
            self._users[key] = self._users.get(key, 0) + 1
        try:
            yield source
        finally:
            with self._lock:
                self._users[key] -= 1
                last = not self._users[key]
                if last:
                    del self._open[key], self._users[key]
            if last:
                source.close()


class _Source:
    """One image on one robot."""

    def __init__(self, session: Session, image: Image, blobs: Blobs) -> None:
        self._session, self._image, self._blobs = session, image, blobs
        self._busy = threading.Lock()
        self._engine: LayerFiles | None = LayerFiles(session, image, blobs)
        """None from the first time on that something cannot be read there."""
        self._holder: Streams | None = None
        self._spool = ""
        self._files: dict[str, str] = {}
        """Digest -> path in the spool."""
        self._large: frozenset[str] = frozenset()
        """Paths of what is worth to be read as it is from a fast link."""

    def get(self, digest: str, what: str, progress: Progress, fast: Callable[[], bool] = lambda: False) -> Blob:
        """Return the configuration or a layer of the image, from the cache or else from the robot.

        Args:
            digest: Its own.
            what: It, in words.
            progress: Told how far it is.
            fast: Asked of a large one: the links are so fast that it need not be compressed.

        Raises:
            ForeignImage: The robot gives something else.
            TransportError: The robot cannot be talked to any more.
            OSError: The cache cannot be written.
        """
        with self._blobs.turn(digest):
            if (blob := self._kept(digest, fast)) is not None:
                return blob
            with self._busy:
                # whoever was busy may have read all of the image
                if (blob := self._kept(digest, fast)) is None:
                    blob = self._read(digest, what, progress, fast)
                    self._blobs.givers.note(digest, self._session.identity)
                return blob

    def _kept(self, digest: str, fast: Callable[[], bool]) -> Blob | None:
        """Return what the cache has of this robot's; what others gave is nothing that it can have sent on."""
        return self._blobs.get(digest, fast) if self._blobs.givers.gave(digest, self._session.identity) else None

    def _read(self, digest: str, what: str, progress: Progress, fast: Callable[[], bool]) -> Blob:
        """Read it from the robot: from its engine, from its spool, or where it can have none, with all of the image."""
        meter = Meter(f"{what} from {self._session.host}", progress)
        if self._engine is not None:
            try:
                return self._engine.get(digest, meter, fast)
            except NotInFiles as error:
                progress(f"{what}: its image is saved by the engine: {error}")
                self._engine = None
        try:
            if self._holder is None:
                progress(f"{what.partition(',')[0]}: {self._session.host} unpacks it to be copied")
                self._unpack()
        except NoSpool as error:
            progress(f"{what}: all of the image is read, as {error}")
            return self._read_all(digest, meter)
        name = self._files.get(digest) or _LAYOUT + digest.removeprefix("sha256:")
        raw = name in self._large and fast()
        pieces = meter.count(
            output(self._session.host, self._session.open_shell(read_script(self._spool, name, raw=raw)))
        )
        first = next(pieces, b"")
        try:
            if raw and not first.startswith(_GZIP):
                return self._blobs.add_content(digest, chain((first,), pieces), raw=True)
            return self._blobs.add(digest, chain((first,), pieces))
        except WrongBlob as error:
            self._session.ask([Query(command=":")])  # raises where the connection was cut: that is no other image
            raise ForeignImage(f"what it gives of {what} is not what its image names: {error}") from error

    def _read_all(self, digest: str, meter: Meter) -> Blob:
        """Keep every layer of the image, as they come anyway, and compress them here."""
        wanted = {self._image.id, *self._image.diff_ids}
        archive = TarStream(meter.count(self._session.save_image(self._image.id, _SAVE_S)))
        came = set[str]()
        try:
            for member in archive:
                if member.isreg() and (kept := self._blobs.add_wanted(wanted, archive.content())) is not None:
                    self._blobs.givers.note(kept.digest, self._session.identity)
                    came.add(kept.digest)
        except (TarError, UnicodeError) as error:
            raise ForeignImage(f"what comes is no archive of an image: {error}") from error
        if digest not in came or (blob := self._blobs.get(digest)) is None:
            raise ForeignImage(f"its archive does not hold {digest}, which its image names")
        return blob

    def close(self) -> None:
        """Let the spool go, and wait a moment until it has gone."""
        if self._holder is not None:
            dismiss(self._holder)

    def _unpack(self) -> None:
        """Have the robot unpack the image, and learn which file is what."""
        holder = self._session.open_shell(save_script(self._image.id))
        try:
            first, _, listed = answer(self._session.host, holder, b"\n\n", _SAVE_S).partition("\n")
            word, *said = first.split()
            if word != "ready" or not said:
                raise NoSpool(f"{self._session.host} cannot unpack it ({' '.join(said)[:400] or 'no reason given'})")
            self._spool, self._files = said[0], _files(listed, self._image)
            self._large = frozenset(name.removeprefix("./") for name in said[1:])
        except BaseException:
            holder.close()
            raise
        self._holder = holder


def _files(listed: str, image: Image) -> dict[str, str]:
    """Return digest -> path for the one image of an archive's list."""
    entries = mappings(json_or_none(listed))
    layers = entries[0].get("Layers") if len(entries) == 1 else None
    names = [string(entries[0].get("Config")), *map(string, layers)] if isinstance(layers, list) else []
    if len(names) != 1 + len(image.diff_ids):
        raise ForeignImage(f"its archive does not list the {len(image.diff_ids)} layers of {config_name(image)}")
    if any(name.startswith(("/", "-")) or ".." in posixpath.normpath(name).split("/") for name in names):
        raise ForeignImage("its archive lists files that lie elsewhere")
    by_hash = names[0].startswith(_LAYOUT)
    return dict(zip(image.diff_ids, names[1:], strict=True)) | ({} if by_hash else {image.id: names[0]})
