"""What a Docker Engine says, as text: paths, error answers, progress streams and container logs.

Takes strings, bytes and responses, gives strings; pure apart from reading a response to its end.
"""

from __future__ import annotations

import urllib.parse
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from srprov.transport.engine_stream import EngineGone
from srprov.untrusted import json_or_none, mapping, string
from srprov.wire import Progress, Reply

if TYPE_CHECKING:
    import requests

_LAST_LINES = 15


def quoted(path: str) -> str:
    """Quote a path of plain text; what a name holds can end neither the path nor climb out of it.

    Raises:
        EngineGone: A part of the path is `.` or `..`.
    """
    if any(part in (".", "..") for part in path.split("/")):
        raise EngineGone(f"refused: {path!r} climbs out of its place")
    return urllib.parse.quote(path, safe="/:@")


def message_of(text: str) -> str:
    """Give the `message` of an engine's error answer, or all of it."""
    message = string(mapping(json_or_none(text)).get("message"))
    return message or " ".join(text.split())[:500]


def follow(response: requests.Response, progress: Progress) -> Reply:
    """Read a progress stream to its end; a line with `error` is a failure."""
    last: deque[str] = deque(maxlen=_LAST_LINES)
    instruction = ""
    for raw in response.iter_lines(chunk_size=None, delimiter=b"\n"):
        event = mapping(json_or_none(raw.decode("utf-8", "replace")))
        if error := failure(event):
            # which instruction failed may have been said long before its last lines
            said = [instruction] if instruction and instruction not in last else []
            return Reply(status=response.status_code, out="\n".join([*said, *last]), err=error, ok=False)
        for line in told(event):
            instruction = line if line.startswith("Step ") else instruction
            last.append(line)
            progress(line)
    return Reply(status=response.status_code, out="\n".join(last))


def lines(pieces: Iterable[bytes]) -> Iterator[str]:
    """Cut bytes that come in pieces into lines of text."""
    rest = b""
    for piece in pieces:
        *whole, rest = (rest + piece).split(b"\n")
        for line in whole:
            yield line.rstrip(b"\r").decode("utf-8", "replace")
    if rest:
        yield rest.decode("utf-8", "replace")


def failure(event: Mapping[str, Any]) -> str:
    """Give the error of a stream's line, or nothing."""
    detail = event.get("errorDetail")
    message = detail.get("message") if isinstance(detail, dict) else None
    return str(message or event.get("error") or "").strip()


def told(event: Mapping[str, Any]) -> list[str]:
    """Give a stream's line as text: build output, or `layer: status progress`."""
    if "stream" in event:
        return [line.rstrip() for line in str(event["stream"]).splitlines() if line.strip()]
    if "status" not in event:
        return []
    name, bar = event.get("id"), event.get("progress")
    return [f"{name}: " * bool(name) + str(event["status"]) + f" {bar}" * bool(bar)]


def demultiplexed(body: bytes) -> bytes:
    """Take the 8-byte headers out of a container's log, in the order it was written; a terminal's log has none."""
    return b"".join(demultiplex([body]))


def demultiplex(chunks: Iterable[bytes]) -> Iterator[bytes]:
    """Do the same for a log that is still coming, cut anywhere."""
    buffer, left, plain = bytearray(), 0, None
    for chunk in chunks:
        buffer += chunk
        if plain is None and len(buffer) >= 8:
            plain = not _is_header(buffer)
        while buffer and (plain or left or len(buffer) >= 8):
            if not plain and not left:
                left = int.from_bytes(buffer[4:8], "big")
                del buffer[:8]
            piece = bytes(buffer if plain else buffer[:left])
            del buffer[: len(piece)]
            left = max(0, left - len(piece))
            yield piece
    if plain is None or left == 0:
        yield bytes(buffer)


def _is_header(data: bytearray) -> bool:
    """Tell a frame's header (stream number, three zeros, length) from text."""
    return data[0] <= 2 and data[1:4] == b"\0\0\0"
