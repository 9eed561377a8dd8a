"""A container's log whose lines have the engine's times -> lines of text, each with one time at its beginning. Pure.

An engine cuts long output into messages of 16 KiB, each a frame with a time of its own, and output and errors take
turns between them. So a line's further times are taken out, and each of the two has lines of its own.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from srprov.transport.engine.answers import EMPTY, LOG_PIECE, LONGEST_LINE, Log, in_text
from srprov.transport.engine.link import EngineGone

_TIME = re.compile(rb"\d{4}-\d\d-\d\dT[\d:.]{8,18}(Z|[+-]\d\d:\d\d) ")
_LONGEST_TIME = 40
_HEADER = 8
"""Bytes before each frame: the stream, three zeros, the length."""


def timed_lines(log: Log) -> Iterator[str]:
    """Return lines as they come; the last one of a stream may have no end.

    Raises:
        EngineGone: It sends frames with nothing in them.
    """
    rests: dict[int, bytearray] = {}
    for stream, piece, begins in _frames(log):
        rest = rests.setdefault(min(stream, 2), bytearray())
        time = _TIME.match(piece) if begins and rest else None
        rest += piece[time.end() :] if time else piece
        if b"\n" in piece:
            *whole, last = rest.split(b"\n")
            for line in whole:
                yield from in_text(bytes(line))
            rest[:] = last
        if len(rest) > LONGEST_LINE:
            yield from in_text(bytes(rest))
            rest.clear()
    for rest in rests.values():
        if rest:
            yield from in_text(bytes(rest))


def _frames(log: Log) -> Iterator[tuple[int, bytes, bool]]:
    """Return a log in parts: stream, bytes, and whether they are the beginning of a frame; a terminal has no frames."""
    data = bytearray()
    while len(data) < _HEADER and (piece := log.read1(LOG_PIECE)):
        data += piece
    framed = len(data) >= _HEADER and data[0] <= 2 and data[1:4] == b"\0\0\0"
    stream, left, begins, came, given = 1, 0, False, len(data), 0
    while data:
        at = 0
        while framed and at < len(data):
            if not left:
                if len(data) - at < _HEADER:
                    break
                stream, left, begins = data[at], int.from_bytes(data[at + 4 : at + 8], "big"), True
                at += _HEADER
                continue
            part = data[at : at + left]
            if begins and len(part) < min(left, _LONGEST_TIME):
                break  # its time is not all here
            yield stream, bytes(part), begins
            at, left, begins, given = at + len(part), left - len(part), False, given + len(part)
        if not framed:
            yield stream, bytes(data), False
            at = given = len(data)
        del data[:at]
        if came > (_HEADER + 1) * given + EMPTY and framed:
            raise EngineGone("its log has more frames than text")
        piece = log.read1(LOG_PIECE)
        if not piece:
            if left and data:
                yield stream, bytes(data), begins
            return
        data += piece
        came += len(piece)
