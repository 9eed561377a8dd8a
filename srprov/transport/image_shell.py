"""A shell of its own on a robot, whose script takes and gives bytes: what it says, what it prints, and its end."""

from __future__ import annotations

import time
from collections.abc import Iterator

from srprov.codes import Code
from srprov.errors import TransportError
from srprov.pace import TOO_LITTLE, Pace
from srprov.session import Streams

_END_S = 10.0
_LONGEST_ANSWER = 1 << 20
_LONGEST_WORDS = 2000


def answer(host: str, streams: Streams, end: bytes, seconds: float) -> str:
    """Return what a script says up to `end`, without it; or what it complained of, if it ends before.

    Raises:
        TransportError: It says nothing of the kind within so many seconds, or too much.
    """
    said, complaint, until = bytearray(), bytearray(), time.monotonic() + seconds
    at = -1
    while at < 0 and not streams.ended:
        out, error = streams.read()
        said += out
        at = said.find(end, max(0, len(said) - len(out) - len(end)))
        complaint += error[: _LONGEST_WORDS - len(complaint)]
        if len(said) > _LONGEST_ANSWER or time.monotonic() > until:
            why = f"within {seconds:g} s" if len(said) <= _LONGEST_ANSWER else "but noise"
            raise TransportError(
                host, f"it said nothing of what it gets {why}", hint="is its disk full or slow?", code=Code.IMAGE_COPY
            )
        if not (out or error):
            streams.wait(0.2, writing=False)
    if at >= 0:
        return bytes(said[:at]).decode("utf-8", "replace")
    return f"no {' '.join(complaint.decode('utf-8', 'replace').split()) or streams.reason()}"


def output(host: str, streams: Streams) -> Iterator[bytes]:
    """Yield what a script prints, to its end; then the shell is closed.

    Raises:
        TransportError: It stopped to print, or trickles.
    """
    pace = Pace()
    try:
        while not streams.ended:
            piece, _ = streams.read()
            if not pace.goes_on(len(piece)):
                raise TransportError(host, f"it gave {TOO_LITTLE}", hint="try again", code=Code.IMAGE_COPY)
            if piece:
                yield piece
                pace.resume()
            else:
                streams.wait(0.2, writing=False)
    finally:
        streams.close()


def send(host: str, streams: Streams, data: bytes, pace: Pace) -> None:
    """Send all of it to a script; `pace` is that of everything that it is sent.

    Raises:
        TransportError: It takes no more, or next to nothing.
    """
    piece = memoryview(data)
    pace.resume()
    while piece:
        sent = streams.write(piece)
        piece = piece[sent:]
        if not pace.goes_on(sent) or (not sent and streams.ended):
            why = streams.reason() if streams.ended else f"it took {TOO_LITTLE}"
            raise TransportError(
                host,
                f"what is sent got no further: {why}",
                hint="apply again: it goes on from there",
                code=Code.IMAGE_COPY,
            )
        if not sent:
            streams.wait(0.2, writing=True)


def dismiss(streams: Streams) -> None:
    """Tell a script that waits for a line to end, and give it a moment to tidy up."""
    streams.write(memoryview(b"end\n"))
    until = time.monotonic() + _END_S
    while not streams.ended and time.monotonic() < until:
        streams.read()
        streams.wait(0.2, writing=False)
    streams.close()
