"""A shell of its own on a robot, whose script takes and gives bytes: what it says, what it prints, and its end."""

from __future__ import annotations

import time
from collections.abc import Iterator

from srprov.errors import TransportError
from srprov.session import Streams

_SILENCE_S = 120.0
_END_S = 10.0
_LONGEST_ANSWER = 1 << 20
_LONGEST_WORDS = 2000


def answer(host: str, streams: Streams, end: bytes, seconds: float) -> str:
    """Return what a script says up to `end`, without it; or what it complained of, if it ends before.

    Raises:
        TransportError: It says nothing of the kind within so many seconds, or too much.
    """
    said, complaint, until = bytearray(), bytearray(), time.monotonic() + seconds
    while end not in said and not streams.ended:
        out, error = streams.read()
        said += out
        complaint += error[: _LONGEST_WORDS - len(complaint)]
        if len(said) > _LONGEST_ANSWER or time.monotonic() > until:
            why = f"within {seconds:g} s" if len(said) <= _LONGEST_ANSWER else "but noise"
            raise TransportError(host, f"it said nothing of what it gets {why}", hint="is its disk full or slow?")
        if not (out or error):
            streams.wait(0.2, writing=False)
    if end in said:
        return bytes(said).partition(end)[0].decode("utf-8", "replace")
    return f"no {' '.join(complaint.decode('utf-8', 'replace').split()) or streams.reason()}"


def output(host: str, streams: Streams) -> Iterator[bytes]:
    """Yield what a script prints, to its end; then the shell is closed.

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
                raise TransportError(host, f"it gave nothing for {_SILENCE_S:g} s", hint="try again")
            else:
                streams.wait(0.2, writing=False)
    finally:
        streams.close()


def send(host: str, streams: Streams, data: bytes) -> None:
    """Send all of it to a script.

    Raises:
        TransportError: It takes no more.
    """
    last, piece = time.monotonic(), memoryview(data)
    while piece:
        if sent := streams.write(piece):
            piece, last = piece[sent:], time.monotonic()
        elif streams.ended or time.monotonic() - last > _SILENCE_S:
            why = streams.reason() if streams.ended else f"nothing went by for {_SILENCE_S:g} s"
            raise TransportError(host, f"what is sent got no further: {why}", hint="apply again: it goes on from there")
        else:
            streams.wait(0.2, writing=True)


def dismiss(streams: Streams) -> None:
    """Tell a script that waits for a line to end, and give it a moment to tidy up."""
    streams.write(memoryview(b"end\n"))
    until = time.monotonic() + _END_S
    while not streams.ended and time.monotonic() < until:
        streams.read()
        streams.wait(0.2, writing=False)
    streams.close()
