"""An archive gets to a robot and into its engine: as a stream, or, when it is large, through a file there.

What is larger than 32 MiB arrives in a file below `/var/lib/srprov`, to which another try adds only the rest; when all
of it is there and its hash is right, the robot loads it by itself. Where there is no place for that, it is streamed.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING

from srprov.errors import TransportError
from srprov.session import Progress, Streams
from srprov.transport.image_progress import Meter, mib
from srprov.transport.image_spool import load_script
from srprov.transport.image_there import Room
from srprov.transport.thin_archive import ThinArchive
from srprov.wire import Reply

if TYPE_CHECKING:
    from srprov.transport.session import BaseSession

SPOOLED = 32 << 20
_SILENCE_S = 120.0
_LONGEST_ANSWER = 64 << 10
_TRIES = 2


def deliver(
    archive: ThinArchive, session: BaseSession, room: Room, timeout_s: float, what: str, progress: Progress
) -> Reply:
    """Send an archive and load it; what came of it in the engine, whoever calls looks up.

    Raises:
        TransportError: The robot cannot be talked to any more.
        OSError: The cache's files are gone.
    """
    if archive.size > SPOOLED:
        digest = hashlib.sha256()
        for piece in archive.pieces():
            digest.update(piece)
        for _ in range(_TRIES):
            spool = _Spool(session, archive, digest.hexdigest(), timeout_s)
            reply = spool.deliver(room, Meter(what, progress, archive.size), progress)
            if reply is not None:
                return reply
            if not spool.possible:
                break
    if lack := room.lack(archive.size, archive.unpacked, spooled=False):
        return Reply(status=0, ok=False, err=lack)
    pieces = Meter(what, progress, archive.size).count(archive.pieces())
    return session.engine.client.load(pieces, timeout_s, progress)


class _Spool:
    """One try to bring an archive into a file on the robot, and to load it from there."""

    def __init__(self, session: BaseSession, archive: ThinArchive, sha256: str, timeout_s: float) -> None:
        self._session, self._archive, self._sha256, self._timeout_s = session, archive, sha256, timeout_s
        self.possible = False
        """There is a place for the file, and something that loads it."""

    def deliver(self, room: Room, meter: Meter, progress: Progress) -> Reply | None:
        """Do it; None when there is no place for it, or what arrived is not what was sent, and is gone."""
        streams = self._session.open_shell(load_script(self._sha256, self._archive.size))
        try:
            word, _, rest = self._answer(streams, 60.0).partition(" ")
            if word != "have" or not rest.isdigit():
                progress(f"{self._session.host} has no place to spool it: {rest[:200]}")
                return None
            self.possible, have = True, min(int(rest[:18]), self._archive.size)
            if lack := room.lack(self._archive.size, self._archive.unpacked, spooled=True, have=have):
                return Reply(status=0, ok=False, err=lack)
            if have:
                progress(f"{mib(have)} MiB of {mib(self._archive.size)} are there from an earlier try")
            meter.begin(have)
            for piece in _from(self._archive.pieces(), have):
                self._send(streams, memoryview(piece))
                meter.add(len(piece))
            progress(f"{meter.text()}, loading")
            word, _, rest = self._answer(streams, self._timeout_s).partition(" ")
            if word == "wrong":
                progress(f"what arrived on {self._session.host} is not what was sent (sha256 {rest[:64]}): again")
                return None
            ok = word == "loaded"
            return Reply(status=200 if ok else 1, ok=ok, err="" if ok else rest[:2000] or streams.reason())
        finally:
            streams.close()

    def _send(self, streams: Streams, piece: memoryview) -> None:
        last = time.monotonic()
        while piece:
            sent = streams.write(piece)
            piece = piece[sent:]
            if sent:
                last = time.monotonic()
                continue
            if streams.ended or time.monotonic() - last > _SILENCE_S:
                why = streams.reason() if streams.ended else f"nothing went by for {_SILENCE_S:g} s"
                raise TransportError(self._session.host, f"the image got no further: {why}", hint="apply again")
            streams.wait(0.2, writing=True)

    def _answer(self, streams: Streams, seconds: float) -> str:
        """Return the next line that the robot says."""
        said, end = bytearray(), time.monotonic() + seconds
        while b"\n" not in said and not streams.ended:
            out, error = streams.read()
            said += out
            if len(said) > _LONGEST_ANSWER or time.monotonic() > end:
                raise TransportError(self._session.host, f"it said nothing of the image within {seconds:g} s")
            if not out and not error:
                streams.wait(0.2, writing=False)
        return bytes(said).partition(b"\n")[0].decode("utf-8", "replace")


def _from(pieces: Iterator[bytes], offset: int) -> Iterator[bytes]:
    """Leave the first `offset` bytes out."""
    for piece in pieces:
        if offset < len(piece):
            yield piece[offset:]
        offset = max(0, offset - len(piece))
