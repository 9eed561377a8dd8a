"""What a robot's own `tar` gives, and takes, in a shell of its own that says at its end how that went.

Takes scripts that `sandbox.ending` ends; gives pieces of bytes, and errors in words.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from srprov.codes import Code
from srprov.errors import TransportError, one_line
from srprov.pace import TOO_LITTLE, Pace
from srprov.sandbox import ENDED
from srprov.session import Streams

_READY = b"ready\n"
_LONGEST_COMPLAINT = 16_384
_SAID = 300
_CHANGED = 1
"""GNU tar's status when a file changed, or went, while it was read. One that only grew is whole as it was listed."""


def taken(host: str, streams: Streams, path: str, why: Mapping[int, str]) -> Iterator[bytes]:
    """Yield what a script gives, to its end.

    Raises:
        TransportError: It failed, or next to nothing comes; or at the end, where something of it was cut or removed.
    """
    shell = _Shell(host, streams, f"{path} cannot be read", why)
    try:
        while not streams.ended:
            if piece := shell.read():
                yield piece
                shell.pace.resume()
            else:
                streams.wait(0.2, writing=False)
        if words := shell.end((0, _CHANGED)):
            said = f"{path} was cut or removed while it was copied, and what is here of it is not whole: {words}"
            raise TransportError(host, said, hint="copy it again when nothing changes there", code=Code.RESULTS)
    finally:
        streams.close()


def given(host: str, streams: Streams, path: str, why: Mapping[int, str], pieces: Iterator[bytes]) -> None:
    """Give a script what it takes, once it says that it is ready, and wait for its end.

    Raises:
        TransportError: It failed, or takes next to nothing.
    """
    shell = _Shell(host, streams, f"{path} cannot be written", why)
    try:
        said = b""
        while not streams.ended and not said.endswith(_READY):
            said = (said + shell.read(0))[-len(_READY) :]
            streams.wait(0.2, writing=False)
        for piece in pieces:
            shell.send(piece)
        while not streams.ended:
            shell.read(0)
            streams.wait(0.2, writing=False)
        shell.end((0,))
    finally:
        streams.close()


class _Shell:
    """A shell under way."""

    def __init__(self, host: str, streams: Streams, what: str, why: Mapping[int, str]) -> None:
        self._host, self._streams, self._what, self._why = host, streams, what, why
        self._complaint = b""
        self.pace = Pace()

    def read(self, sent: int | None = None) -> bytes:
        """Return what it prints now, and keep what it complains of.

        What it has taken counts, where something is sent: it may print for ever, and take nothing.
        """
        piece, error = self._streams.read()
        self._complaint = (self._complaint + error)[-_LONGEST_COMPLAINT:]
        if not self.pace.goes_on(len(piece) if sent is None else sent):
            said = f"{self._what}: {TOO_LITTLE}"
            raise TransportError(self._host, said, hint="try again", code=Code.LOST)
        return piece

    def send(self, piece: bytes) -> None:
        """Send all of it; how long it took to come is no matter."""
        data = memoryview(piece)
        self.pace.resume()
        while data:
            sent = self._streams.write(data)
            data = data[sent:]
            self.read(sent)
            if data and self._streams.ended:
                self.end(())
            if not sent:
                self._streams.wait(0.2, writing=True)

    def end(self, fine: tuple[int, ...]) -> str:
        """Return what it complained of, unless it ended well; raise TransportError where its status is not fine."""
        ended = ENDED.search(self._complaint)
        if ended is None:
            said = f"{self._what}: it ended too early: {self._streams.reason()}"
            raise TransportError(self._host, said, hint="try again", code=Code.LOST)
        words = self._complaint[: ended.start()].decode("utf-8", "replace")
        if (status := int(ended[1])) not in fine:
            raise failed(self._host, self._what, status, words, self._why)
        return one_line(words)[-_SAID:] if status else ""


def failed(host: str, what: str, status: int, complaint: str, why: Mapping[int, str]) -> TransportError:
    """Return the error of a script that ended with a status."""
    words = why.get(status) or one_line(complaint)[-_SAID:] or f"status {status}"
    return TransportError(host, f"{what}: {words}", code=Code.ENGINE)
