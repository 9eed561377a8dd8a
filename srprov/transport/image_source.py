"""Layers of an image come from the robot that has it into this machine's cache, each once for all that want it.

On the robot, `docker save` is unpacked into a spool below `/var/lib/srprov`, which a shell of its own holds and removes
when it ends. From there only what the cache lacks is read, compressed by the robot. The bytes are compared with the
digests that the image names, so that it does not matter who could write to the spool.
"""

from __future__ import annotations

import contextlib
import posixpath
import threading
import time
from collections.abc import Iterator

from srprov.errors import TransportError
from srprov.layers import Image, config_name
from srprov.session import Progress, Session, Streams
from srprov.transport.blobs import Blob, Blobs, WrongBlob
from srprov.transport.image_archive import ForeignImage
from srprov.transport.image_progress import Meter
from srprov.transport.image_spool import read_script, save_script
from srprov.untrusted import json_or_none, mappings, string

_SILENCE_S = 120.0
_SAVE_S = 1800.0
_REMOVAL_S = 10.0
_LONGEST_ANSWER = 1 << 20
_COMPLAINT = 4096


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
        self._holder: Streams | None = None
        self._spool = ""
        self._files: dict[str, str] = {}
        """Digest -> path in the spool."""

    def get(self, digest: str, what: str, progress: Progress) -> Blob:
        """Return the configuration or a layer of the image, from the cache or else from the robot.

        Raises:
            ForeignImage: The robot gives something else.
            NoSpool: The robot cannot unpack the image.
            TransportError: The robot cannot be talked to any more.
            OSError: The cache cannot be written.
        """
        with self._blobs.turn(digest):
            if (blob := self._blobs.get(digest)) is not None:
                return blob
            with self._busy:
                if self._holder is None:
                    progress(f"{what}: {self._session.host} saves it")
                    self._unpack()
                script = read_script(self._spool, self._files[digest])
                pieces = _output(self._session, self._session.open_shell(script))
                try:
                    return self._blobs.add(digest, Meter(f"{what} from {self._session.host}", progress).count(pieces))
                except WrongBlob as error:
                    raise ForeignImage(f"what it gives of {what} is not what its image names: {error}") from error

    def close(self) -> None:
        """Let the spool go, and wait a moment until it has gone."""
        if (holder := self._holder) is not None:
            holder.write(memoryview(b"\n"))
            end = time.monotonic() + _REMOVAL_S
            while not holder.ended and time.monotonic() < end:
                holder.read()
                holder.wait(0.2, writing=False)
            holder.close()

    def _unpack(self) -> None:
        """Have the robot unpack the image, and learn which file is what."""
        holder = self._session.open_shell(save_script(self._image.id))
        try:
            said = _answer(self._session.host, holder)
            first, _, listed = said.partition(b"\n")
            word, _, spool = first.decode("utf-8", "replace").partition(" ")
            if word != "ready":
                raise NoSpool(f"{self._session.host} cannot unpack it: {spool[:400] or 'no reason given'}")
            self._spool, self._files = spool, _files(listed.decode("utf-8", "replace"), self._image)
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
    return dict(zip((image.id, *image.diff_ids), names, strict=True))


def _answer(host: str, streams: Streams) -> bytes:
    """Return what a shell says up to an empty line; it goes on to run."""
    said, complaint, end = bytearray(), bytearray(), time.monotonic() + _SAVE_S
    while b"\n\n" not in said and not streams.ended:
        out, error = streams.read()
        said += out
        complaint += error[: _COMPLAINT - len(complaint)]
        if len(said) > _LONGEST_ANSWER:
            raise ForeignImage("its archive's list of images is longer than any sensible one")
        if time.monotonic() > end:
            raise TransportError(host, f"it saved no image within {_SAVE_S:g} s", hint="is its disk full or slow?")
        if not out:
            streams.wait(0.2, writing=False)
    if b"\n\n" in said:
        return bytes(said)
    return b"no " + b" ".join(complaint.split()) or b"no"


def _output(session: Session, streams: Streams) -> Iterator[bytes]:
    """Yield what a shell prints to its end.

    Raises:
        TransportError: It stopped to print.
    """
    last = time.monotonic()
    try:
        while not streams.ended:
            piece, _ = streams.read()
            if piece:
                yield piece
                last = time.monotonic()
            elif time.monotonic() - last > _SILENCE_S:
                raise TransportError(session.host, f"it gave nothing for {_SILENCE_S:g} s", hint="try again")
            else:
                streams.wait(0.2, writing=False)
    finally:
        streams.close()
