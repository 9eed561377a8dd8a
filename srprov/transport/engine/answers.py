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
_LONGEST_LINE = 1 << 20
_LOG_PIECE = 64 * 1024


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
    """Return the `message` of an engine's error answer, or all of it."""
    return string(mapping(json_or_none(text)).get("message")) or " ".join(text.split())[:500]


def lines(pieces: Iterable[bytes]) -> Iterator[str]:
    """Cut bytes that come in pieces into lines of text; a line without end is cut where it gets too long."""
    rest = b""
    for piece in pieces:
        *whole, rest = (rest + piece).split(b"\n")
        if len(rest) > _LONGEST_LINE:
            whole, rest = [*whole, rest], b""
        for line in whole:
            yield line.rstrip(b"\r").decode("utf-8", "replace")
    if rest:
        yield rest.decode("utf-8", "replace")


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
    return words or ("the engine did not say why" if error or detail else "")


def told(event: Mapping[str, Any]) -> list[str]:
    """Return an event as text: build output, or `layer: status progress`."""
    stream, status, name, bar = (string(event.get(key)) for key in ("stream", "status", "id", "progress"))
    if stream:
        return [line.rstrip() for line in stream.splitlines() if line.strip()]
    return [f"{name}: " * bool(name) + status + f" {bar}" * bool(bar)] if status else []


class Log(Protocol):
    """A container's log as it comes."""

    def read(self, size: int, /) -> bytes:
        """Return so many bytes, fewer only at the end."""

    def read1(self, size: int, /) -> bytes:
        """Return at most so many bytes, as soon as there are some."""


def demultiplexed(log: Log) -> Iterator[bytes]:
    """Take the 8-byte headers (stream, three zeros, length) out of a log; one of a terminal has none.

    The docker SDK's `logs` asks whether there is a terminal by another request, keeps a frame of any length that the
    engine claims in memory, and takes a lost connection for the end of the log.
    """
    header = log.read(8)
    if not (header[:1] <= b"\2" and header[1:4] == b"\0\0\0"):
        while header:
            yield header
            header = log.read1(_LOG_PIECE)
    while len(header) == 8:
        left = int.from_bytes(header[4:], "big")
        while left and (piece := log.read(min(left, _LOG_PIECE))):
            left -= len(piece)
            yield piece
        header = log.read(8)
