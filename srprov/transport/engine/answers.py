"""What a Docker Engine says, as text: paths, error answers, progress streams and container logs. Pure.

An engine is believed nothing: whatever it sends, lines have a longest length, JSON that makes no sense is skipped, and
nothing is kept but the last lines.
"""

from __future__ import annotations

import urllib.parse
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Protocol

from srprov.session import Progress
from srprov.transport.engine.link import EngineGone
from srprov.untrusted import json_or_none, mapping, string
from srprov.wire import Reply

_LAST_LINES = 15
LONGEST_LINE = 1 << 20
_LONGEST_WORDS = 2000
"""Characters of a line of progress, or of a failure."""
LOG_PIECE = 64 * 1024
_FRAME = 8
"""Bytes of a frame's header in a log, before one byte of text at least."""
EMPTY = 1 << 20
"""Bytes of frames with nothing in them that are let pass."""


def quoted(path: str) -> str:
    """Quote a path of plain text; what a name holds can end neither the path nor climb out of it.

    Raises:
        EngineGone: A part of the path is `.` or `..`.
    """
    return urllib.parse.quote(within(path), safe="/:@")


def within(path: str) -> str:
    """Return the path.

    Raises:
        EngineGone: A part of it is `.` or `..`.
    """
    if any(part in (".", "..") for part in path.split("/")):
        raise EngineGone(f"refused: {path!r} climbs out of its place")
    return path


def message_of(text: str) -> str:
    """Return the `message` of an engine's error answer, or the beginning of all of it."""
    return cut(string(mapping(json_or_none(text)).get("message"))) or " ".join(text[:5000].split())[:500]


def lines(pieces: Iterable[bytes]) -> Iterator[str]:
    """Cut bytes that come in pieces into lines of text; a line without end is cut where it gets too long."""
    rest = bytearray()
    for piece in pieces:
        first, feed, others = piece.partition(b"\n")
        rest += first
        if feed:
            *whole, last = others.split(b"\n")
            for line in (bytes(rest), *whole):
                yield from in_text(line)
            rest = bytearray(last)
        if len(rest) > LONGEST_LINE:
            yield from in_text(bytes(rest))
            rest = bytearray()
    if rest:
        yield from in_text(bytes(rest))


def in_text(line: bytes) -> Iterator[str]:
    """Decode a line, in as many parts as its length makes necessary."""
    for at in range(0, max(1, len(line)), LONGEST_LINE + LOG_PIECE):
        yield line[at : at + LONGEST_LINE + LOG_PIECE].rstrip(b"\r").decode("utf-8", "replace")


def events(pieces: Iterable[bytes]) -> Iterator[Mapping[str, Any]]:
    """Read a progress stream, one JSON object per line.

    The docker SDK's own decoder keeps an answer without end in memory, parses it anew with each piece, fails at deep
    nesting, and cuts characters in two.
    """
    for line in lines(pieces):
        yield mapping(json_or_none(line))


def follow(pieces: Iterable[bytes], status: int, progress: Progress) -> Reply:
    """Read a progress stream to its end; an event with `error` is a failure."""
    last: deque[str] = deque(maxlen=_LAST_LINES)
    instruction = ""
    for event in events(pieces):
        if error := failure(event):
            # which instruction failed may have been said long before its last lines
            said = [instruction] if instruction and instruction not in last else []
            return Reply(status=status, out="\n".join([*said, *last]), err=error, ok=False)
        for line in told(event):
            instruction = line if line.startswith("Step ") else instruction
            last.append(line)
            progress(line)
    return Reply(status=status, out="\n".join(last))


def failure(event: Mapping[str, Any]) -> str:
    """Return the error of an event, or nothing."""
    detail, error = event.get("errorDetail"), event.get("error")
    words = string(mapping(detail).get("message")).strip() or string(error).strip()
    return cut(words) or ("the engine did not say why" if error or detail else "")


def told(event: Mapping[str, Any]) -> list[str]:
    """Return an event as text: build output, or `layer: status progress`."""
    stream, status, name, bar = (string(event.get(key)) for key in ("stream", "status", "id", "progress"))
    if stream:
        return [cut(line.rstrip()) for line in stream.splitlines() if line.strip()]
    return [cut(f"{name}: " * bool(name) + status + f" {bar}" * bool(bar))] if status else []


def cut(words: str) -> str:
    """Return words as they are, or their beginning and how much more there is."""
    more = len(words) - _LONGEST_WORDS
    return words if more <= 0 else f"{words[:_LONGEST_WORDS]}… ({more} characters more)"


class Log(Protocol):
    """A container's log as it comes."""

    def read1(self, size: int, /) -> bytes:
        """Return at most so many bytes, as soon as there are some; none at the end."""


def demultiplexed(log: Log) -> Iterator[bytes]:
    """Take the 8-byte headers (stream, three zeros, length) out of a log; one of a terminal has none.

    The docker SDK's `logs` asks whether there is a terminal by another request, keeps a frame of any length that the
    engine claims in memory, and takes a lost connection for the end of the log.

    Raises:
        EngineGone: It sends frames with nothing in them.
    """
    data = bytearray()
    while len(data) < 8 and (piece := log.read1(LOG_PIECE)):
        data += piece
    framed = len(data) >= 8 and data[0] <= 2 and data[1:4] == b"\0\0\0"
    left, came, given = 0, len(data), 0
    while data:
        text, left = _take(data, left) if framed else (bytes(data), 0)
        if not framed:
            data.clear()
        if text:
            yield text
        given += len(text)
        if came > (_FRAME + 1) * given + EMPTY:
            raise EngineGone("its log has more frames than text")
        if not (piece := log.read1(LOG_PIECE)):
            return
        data += piece
        came += len(piece)


def _take(data: bytearray, left: int) -> tuple[bytes, int]:
    """Remove the frames that are here from `data`; return their text, and what is still to come of the last one."""
    at, text = 0, bytearray()
    while True:
        end = min(at + left, len(data))
        text += data[at:end]
        left, at = left - (end - at), end
        if left or len(data) - at < 8:
            break
        left, at = int.from_bytes(data[at + 4 : at + 8], "big"), at + 8
    del data[:at]
    return bytes(text), left
