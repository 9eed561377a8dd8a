"""Questions to the Docker Engine of one robot: GETs of one batch go out together, the answers come back in one trip.

Takes a way to dial the engine and `EngineQuery`s, gives a reply for each. HTTP/1.1 lets a client send requests before
the answers to earlier ones are there (RFC 9112, 9.3.2), and Go's server, which Docker's and Podman's engines are built
on, answers them in order. `http.client` reads the answers; the docker SDK knows no such thing, takes 0.15 s to import,
and serves what changes something (`engine.py`).

Paths carry no API version: the engine answers in its own newest, and every parser takes only what it knows.
"""

from __future__ import annotations

import http.client
import io
import json
import threading
import urllib.parse
from collections.abc import Callable, Sequence
from typing import Any

from srprov.errors import TransportError
from srprov.transport.engine_stream import Dial, EngineGone, EngineSocket
from srprov.transport.engine_text import demultiplexed, message_of, quoted
from srprov.wire import EngineQuery, Reply, Traffic

_DIAL_S = 20.0
_LEAST_S = 0.05
_FAILURES = (http.client.HTTPException, OSError, EOFError)


class EngineReader:
    """One robot's engine, for reading. Threads may use it at the same time; a batch waits for the one before it."""

    def __init__(self, host: str, dial: Dial, traffic: Traffic, alive: Callable[[], bool]) -> None:
        """Take the robot's name, how to open a stream, where to count, and how to see that the robot is gone."""
        self._host = host
        self._dial = dial
        self._traffic = traffic
        self._alive = alive
        self._busy = threading.Lock()
        self._stream: _Answers | None = None
        self.api_version = ""
        """As the last answer named it; empty before the first one."""

    def warm(self) -> None:
        """Dial ahead of the first batch; for a thread of its own."""
        with self._busy:
            if self._stream is None:
                try:
                    self._stream = _Answers(self._dial(_DIAL_S))
                except _FAILURES:
                    return  # whoever asks first dials again and gets the reason

    def close(self) -> None:
        """Close the stream; a batch that is under way in another thread ends with that."""
        stream = self._stream
        if stream is not None:
            stream.abort()

    def ask(self, queries: Sequence[EngineQuery], *, beside: bool = False) -> list[Reply]:
        """Ask everything in one round trip; once there is no engine, there is none for the rest.

        With `beside` somebody asks the robot's shell at the same time, and that is counted.

        Raises:
            TransportError: The robot, not only its engine, is gone.
        """
        if not queries:
            return []
        with self._busy:
            replies: list[Reply] = []
            while len(replies) < len(queries):
                used = self._stream is not None
                try:
                    self._batch(queries[len(replies) :], replies, counted=not beside or bool(replies))
                except _FAILURES as error:
                    self._drop()
                    # An engine may close an idle stream just as it is used again; a GET can be repeated.
                    if used and not isinstance(error, (EngineGone, TimeoutError)):
                        continue
                    gone = self._unreachable(error, queries[len(replies)].timeout_s)
                    replies += [gone] * (len(queries) - len(replies))
            return replies

    def _batch(self, queries: Sequence[EngineQuery], replies: list[Reply], *, counted: bool) -> None:
        """Send all requests and add the replies as they come; each has its own time."""
        if self._stream is None:
            self._stream = _Answers(self._dial(min(_DIAL_S, queries[0].timeout_s)))
        stream = self._stream
        self._traffic.round_trips += counted
        stream.send(b"".join(_request(query) for query in queries), queries[0].timeout_s)
        for query in queries:
            reply, last = stream.next(query)
            self.api_version = stream.api_version or self.api_version
            replies.append(reply)
            if last:
                self._drop()
                return  # the rest is asked again, on a new stream

    def _drop(self) -> None:
        """Forget the stream."""
        if self._stream is not None:
            self._stream.close()
        self._stream = None

    def _unreachable(self, error: BaseException, seconds: float) -> Reply:
        """Give the reply for an engine that does not answer, or raise when the whole robot is gone."""
        if not self._alive():
            raise TransportError(
                self._host, "the connection was lost", hint="is the robot up, and its network?"
            ) from error
        if isinstance(error, TimeoutError):
            return Reply(status=0, ok=False, err=f"the Docker Engine did not answer within {seconds:g} s")
        if isinstance(error, http.client.HTTPException):
            said = " ".join(str(error).split())[:200]
            return Reply(status=0, ok=False, err=f"what answers is no Docker Engine ({said or type(error).__name__})")
        return Reply(status=0, ok=False, err=" ".join(str(error).split()) or "the Docker Engine closed the connection")


class _Answers:
    """A stream to the engine, and the answers that come out of it one after the other."""

    def __init__(self, socket: EngineSocket) -> None:
        self._socket = socket
        self._file = socket.makefile("rb")
        self.api_version = ""

    def send(self, data: bytes, seconds: float) -> None:
        """Send requests."""
        self._socket.settimeout(max(_LEAST_S, seconds))
        self._socket.sendall(data)

    def next(self, query: EngineQuery) -> tuple[Reply, bool]:
        """Read the next answer; and tell whether the engine ends the stream behind it."""
        self._socket.settimeout(max(_LEAST_S, query.timeout_s))
        answer = http.client.HTTPResponse(_Shared(self._file), method="GET")  # type: ignore[arg-type]  # it only calls makefile
        answer.begin()
        body = answer.read()
        self.api_version = answer.headers.get("Api-Version", "")
        text = (demultiplexed(body) if query.path.endswith("/logs") else body).decode("utf-8", "replace")
        if query.headers:
            text = json.dumps({name.lower(): value for name, value in answer.headers.items()})
        ok = 200 <= answer.status < 300
        reply = Reply(status=answer.status, out=text, err="" if ok else message_of(text), ok=ok)
        return reply, answer.will_close

    def close(self) -> None:
        """Close the stream."""
        self._socket.close()
        self._file.close()

    def abort(self) -> None:
        """Close it under a reader's hands."""
        self._socket.abort()


class _Shared:
    """What `HTTPResponse` takes for its socket: the file stays open, for it may hold a part of the next answer."""

    def __init__(self, file: io.BufferedReader) -> None:
        self._file = file

    def makefile(self, _mode: str) -> Any:  # noqa: ANN401 - a file, as far as http.client uses one
        return _KeptOpen(self._file)


class _KeptOpen:
    """A file whose `close` leaves it open."""

    def __init__(self, file: io.BufferedReader) -> None:
        self.read = file.read
        self.read1 = file.read1
        self.readinto = file.readinto
        self.readline = file.readline
        self.peek = file.peek

    def flush(self) -> None:
        """Nothing is written."""

    def close(self) -> None:
        """Leave it open."""


def _request(query: EngineQuery) -> bytes:
    """Give the bytes of one GET."""
    params = urllib.parse.urlencode(query.params)
    target = quoted(query.path) + (f"?{params}" if params else "")
    return f"GET {target} HTTP/1.1\r\nHost: engine\r\n\r\n".encode("ascii")
