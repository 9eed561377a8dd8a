"""One image as a registry serves it, over streams that somebody else accepts: no port is opened here.

Takes an image as a value and streams on which requests come; gives what a pull by digest needs, and nothing else:
no list, no tag, no upload. Whoever does not know the repository's name, which is random, gets 404.

Source: OCI Distribution Specification 1.1, "Pull"; Image Manifest Version 2, Schema 2; RFC 9110, section 14 (Range).
"""

from __future__ import annotations

import contextlib
import io
import json
import re
from collections.abc import Callable, Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from typing import Any, BinaryIO, Protocol

import msgspec

from srprov.transport.blob import Blob, open_regular
from srprov.transport.deadline import Deadline
from srprov.transport.registry_image import MANIFEST, ServedImage, sha256

_BLOB = "application/octet-stream"
_PIECE = 32 * 1024
"""What one packet of SSH holds."""
_STRANGER_S = 10.0
"""Without a request for something that is here, a connection is closed after so many seconds."""
_IDLE_S = 60.0
"""From one such request to the end of the next, and for each piece of an answer to be taken."""
_TLS_HANDSHAKE = b"\x16"
_HERE = b"{}"
_NOTHING = (0, -1)
"""First and last byte of an empty file."""
_RANGE = re.compile("bytes=([0-9]{0,18})-([0-9]{0,18})")

Sent = Callable[[str, int], None]
"""Is told of which digest how many bytes went out; 0 when something that is here is asked for."""


class Stream(Protocol):
    """What a socket and a channel of paramiko have in common."""

    def settimeout(self, timeout: float | None, /) -> None:
        """Let each wait end after so many seconds with TimeoutError."""

    def recv(self, size: int, /) -> bytes:
        """Return what is here, at most so much; nothing at the end."""

    def send(self, data: bytes, /) -> int:
        """Send some of it; 0 when the stream is closed."""


def answer(stream: Stream, image: ServedImage, sent: Sent) -> None:
    """Answer the requests on one connection, until either end closes it or nothing comes for a minute."""
    with contextlib.suppress(OSError, EOFError):  # the far end went away, or takes nothing: it asks again if it wants
        _Connection(stream, image, sent)


class _Content(msgspec.Struct, frozen=True):
    """What stands at one path."""

    kind: str
    digest: str
    size: int
    source: Blob | bytes
    """A layer is opened when it is asked for."""

    def open(self) -> BinaryIO:
        """Return its bytes."""
        return io.BytesIO(self.source) if isinstance(self.source, bytes) else open_regular(self.source.path)


def _contents(image: ServedImage) -> Mapping[str, _Content]:
    """Return path -> what stands there."""
    found = {f"/v2/{image.name}/manifests/{image.digest}": _small(MANIFEST, image.manifest)}
    config = _small(_BLOB, image.config)
    found[f"/v2/{image.name}/blobs/{config.digest}"] = config
    for one in image.layers:
        found[f"/v2/{image.name}/blobs/{one.compressed}"] = _Content(_BLOB, one.compressed, one.size, one)
    return found


def _small(kind: str, content: bytes) -> _Content:
    return _Content(kind, sha256(content), len(content), content)


class _Connection(BaseHTTPRequestHandler):
    """HTTP/1.1 on one stream. Errors are JSON, and end the connection."""

    protocol_version = "HTTP/1.1"

    def __init__(self, stream: Stream, image: ServedImage, sent: Sent) -> None:
        self._stream, self._contents, self._sent = stream, _contents(image), sent
        super().__init__(stream, ("", 0), None)  # type: ignore[arg-type]  # it hands them to `setup` alone

    def setup(self) -> None:
        """Read and write by the stream's own means: a channel is no socket."""
        self._incoming = _Incoming(self._stream)
        self.rfile = self._reader = io.BufferedReader(self._incoming)
        self.wfile = _Outgoing(self._stream)

    def handle(self) -> None:
        """Answer requests; an engine that tries TLS first is told at once that there is none, and comes again."""
        if self._reader.peek(1)[:1] == _TLS_HANDSHAKE:
            self.command = ""
            self.send_error(HTTPStatus.BAD_REQUEST)
        else:
            super().handle()

    def do_GET(self) -> None:
        """Give what stands at the path, or the range of it that is asked for."""
        path = self.path.partition("?")[0]
        content = self._contents.get(path)
        if content is not None:
            self._stream.settimeout(_IDLE_S)
            self._sent(content.digest, 0)
            self._give(content)
            self._incoming.deadline = Deadline(_IDLE_S)
        elif path in ("/v2", "/v2/"):
            self.send_response_only(HTTPStatus.OK)
            self._headers("application/json", len(_HERE))
            self.end_headers()
            self._body(_HERE)
        else:
            self.send_error(HTTPStatus.NOT_FOUND)

    do_HEAD = do_GET

    def _give(self, content: _Content) -> None:
        first, last = _part(self.headers.get("Range", ""), content.size)
        if first > last and (first, last) != _NOTHING:
            self.send_error(HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE, size=content.size)
            return
        try:
            file = content.open()
        except OSError as error:  # the cache has lost it
            self.send_error(HTTPStatus.NOT_FOUND, explain=error.strerror)
            return
        whole = last - first + 1 == content.size
        with file:
            file.seek(first)
            self.send_response_only(HTTPStatus.OK if whole else HTTPStatus.PARTIAL_CONTENT)
            self._headers(content.kind, last - first + 1)
            self.send_header("Docker-Content-Digest", content.digest)
            self.send_header("Accept-Ranges", "bytes")
            if not whole:
                self.send_header("Content-Range", f"bytes {first}-{last}/{content.size}")
            self.end_headers()
            if self.command != "HEAD":
                self._copy(file, content.digest, last - first + 1)

    def _copy(self, file: BinaryIO, digest: str, size: int) -> None:
        while size and (piece := file.read(min(size, _PIECE))):
            self.wfile.write(piece)
            size -= len(piece)
            self._sent(digest, len(piece))
        if size:
            self.close_connection = True  # the file is shorter than it was: what was announced cannot be given

    def _headers(self, kind: str, size: int) -> None:
        self.send_header("Docker-Distribution-Api-Version", "registry/2.0")
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(size))

    def send_error(self, code: int, message: str | None = None, explain: str | None = None, size: int = 0) -> None:
        """Answer with an error of a registry, and close; `size` is that of what has no such range."""
        words = message or HTTPStatus(code).phrase
        name = "NOT_FOUND" if code == HTTPStatus.NOT_FOUND else "UNSUPPORTED"
        body = json.dumps({"errors": [{"code": name, "message": words, "detail": explain}]}).encode()
        self.close_connection = True
        self.request_version = "HTTP/1.1"  # what could not be read counts as HTTP/0.9, which has no status
        self.send_response_only(code)
        self._headers("application/json", len(body))
        self.send_header("Connection", "close")
        if code == HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE:
            self.send_header("Content-Range", f"bytes */{size}")
        self.end_headers()
        self._body(body)

    def _body(self, body: bytes) -> None:
        if self.command != "HEAD":
            self.wfile.write(body)

    def log_message(self, *_words: Any) -> None:  # noqa: ANN401 - as the base class has it
        """Say nothing: what comes here is a stranger's."""


def _part(wanted: str, size: int) -> tuple[int, int]:
    """Return the first and the last byte of a range; all of it where the header is none that is known."""
    match = _RANGE.fullmatch(wanted.strip())
    if match is None or match[0] == "bytes=-":
        return 0, size - 1
    if not match[1]:
        return max(0, size - int(match[2])), size - 1 if int(match[2]) else -1
    last = min(int(match[2]), size - 1) if match[2] else size - 1
    return int(match[1]), last


class _Incoming(io.RawIOBase):
    """The reading half of a stream, until a moment that no trickle puts off."""

    def __init__(self, stream: Stream) -> None:
        super().__init__()
        self._stream = stream
        self.deadline = Deadline(_STRANGER_S)

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:  # noqa: ANN401 - a writable buffer
        if self.deadline.passed:
            raise TimeoutError
        self._stream.settimeout(self.deadline.left(0.001))
        data = self._stream.recv(len(buffer))
        buffer[: len(data)] = data
        return len(data)


class _Outgoing(io.BufferedIOBase):
    """The writing half; a write ends when all of it was taken."""

    def __init__(self, stream: Stream) -> None:
        super().__init__()
        self._stream = stream

    def writable(self) -> bool:
        return True

    def write(self, data: Any) -> int:  # noqa: ANN401 - a readable buffer
        view = memoryview(data)
        while view:
            sent = self._stream.send(bytes(view[:_PIECE]))
            if not sent:
                raise EOFError
            view = view[sent:]
        return len(data)
