"""An archive gets to a robot and into its engine: as a stream, or, when it is large, through a file there.

What is larger than 32 MiB, or than 256 MiB on a fast link, would take long to be sent again: it arrives in a file below
`/var/lib/srprov`, to which another try adds only the rest; when all of it is there and its hash is right, the robot
loads it by itself. All else, and where there is no place for that, is streamed into the engine.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from typing import TYPE_CHECKING

from srprov.pace import Pace
from srprov.session import Progress
from srprov.spool import LARGE, load_script
from srprov.transport.image_progress import Meter, mib
from srprov.transport.image_shell import answer, dismiss, send
from srprov.transport.image_there import Room
from srprov.transport.link_rate import Links
from srprov.transport.thin_archive import ThinArchive
from srprov.wire import Reply

if TYPE_CHECKING:
    from srprov.transport.session import BaseSession

_LARGE_IF_FAST = 256 << 20
"""Bytes that a fast link sends again within ten seconds."""
_TRIES = 2


def deliver(
    archive: ThinArchive, session: BaseSession, room: Room, links: Links, timeout_s: float, what: str,
    progress: Progress,
) -> Reply:  # fmt: skip
    """Send an archive and load it; what came of it in the engine, whoever calls looks up.

    Raises:
        TransportError: The robot cannot be talked to any more.
        OSError: The cache's files are gone.
    """
    if archive.size > _LARGE_IF_FAST or (archive.size > LARGE and not links.takes_fast(session)):
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
        host, streams = self._session.host, self._session.open_shell(load_script(self._sha256, self._archive.size))
        try:
            word, _, rest = answer(host, streams, b"\n", 60.0).partition(" ")
            if word != "have" or not rest.isdecimal():
                progress(f"{host} has no place to spool it: {rest[:200]}")
                return None
            self.possible, have = True, min(int(rest[:18]), self._archive.size)
            if lack := room.lack(self._archive.size, self._archive.unpacked, spooled=True, have=have):
                dismiss(streams)
                return Reply(status=0, ok=False, err=lack)
            if have:
                progress(f"{mib(have)} of {mib(self._archive.size)} MiB are there from an earlier try")
            meter.begin(have)
            send(host, streams, b"go\n", pace := Pace())
            for piece in _from(self._archive.pieces(), have):
                send(host, streams, piece, pace)
                meter.add(len(piece))
            progress(f"{meter.text()}, loading")
            word, _, rest = answer(host, streams, b"\n", self._timeout_s).partition(" ")
            if word == "wrong":
                progress(f"what arrived on {host} is not what was sent (sha256 {rest[:64]}): again")
                return None
            ok = word == "loaded"
            return Reply(status=200 if ok else 1, ok=ok, err="" if ok else rest[:2000] or streams.reason())
        finally:
            streams.close()


def _from(pieces: Iterator[bytes], offset: int) -> Iterator[bytes]:
    """Leave the first `offset` bytes out."""
    for piece in pieces:
        if offset < len(piece):
            yield piece[offset:]
        offset = max(0, offset - len(piece))
