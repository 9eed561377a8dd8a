"""Questions to the Docker Engine of one robot: GETs of one batch go out together, the answers come back in one trip.

Takes an `EngineLink` and `EngineQuery`s, returns a reply for each. HTTP/1.1 lets a client send requests before the
answers to earlier ones are there (RFC 9112, 9.3.2), and Go's server, which Docker's and Podman's engines are built on,
answers them in order. `http.client` reads the answers; the docker SDK knows no such thing and takes 0.15 s to import.

Paths carry no API version: the engine answers in its own newest, and every parser takes only what it knows.
"""

from __future__ import annotations

import http.client
import json
import threading
import urllib.parse
from collections.abc import Sequence

from msgspec.structs import replace

from srprov.transport.deadline import BATCH_S, Deadline
from srprov.transport.engine.answers import message_of, quoted
from srprov.transport.engine.link import EngineGone, EngineLate, EngineLink, EngineSocket
from srprov.untrusted import MAX_JSON_CHARACTERS, json_of_robot
from srprov.wire import EngineQuery, Reply

_DIAL_S = 20.0
_LEAST_S = 0.05
_LONGEST_ANSWER = MAX_JSON_CHARACTERS
"""Bytes; what is longer would not be parsed."""
_LONGEST_BATCH = 4 * _LONGEST_ANSWER
_PIECE = 1 << 20
_FAILURES = (EngineGone, http.client.HTTPException, OSError, EOFError)


class _UnreadError(EngineGone):
    """The engine answers, and with more than is read: what it says is not known."""


_IS_THERE = {_UnreadError: 200, EngineLate: 504}
"""Failures of an engine that is there -> what its reply's status is: it runs containers, whatever it says of them."""


class EngineReader:
    """One robot's engine, for reading. Threads may use it at the same time; a batch waits for the one before it."""

    def __init__(self, link: EngineLink) -> None:
        """Take how the engine is reached."""
        self._link = link
        self._busy = threading.Lock()
        self._stream: EngineSocket | None = None
        self.api_version = ""
        """As the last answer named it; empty before the first one."""

    def warm(self) -> None:
        """Dial ahead of the first batch; for a thread of its own."""
        with self._busy:
            if self._stream is None:
                try:
                    self._stream = self._link.open(_DIAL_S)
                except _FAILURES:
                    return  # whoever asks first dials again and gets the reason

    def close(self) -> None:
        """Close the stream; a batch that is under way in another thread ends with that."""
        if (stream := self._stream) is not None:
            stream.abort()

    def ask(self, queries: Sequence[EngineQuery], *, alongside_shell: bool = False) -> list[Reply]:
        """Ask everything in one round trip; once there is no engine, there is none for the rest.

        With `alongside_shell` the robot's shell is asked at the same time, and only that round trip is counted.

        Raises:
            TransportError: The robot, not only its engine, is gone.
        """
        if not queries:
            return []
        with self._busy:
            replies: list[Reply] = []
            whole = Deadline(max(query.timeout_s for query in queries) + BATCH_S)
            while len(replies) < len(queries):
                used = self._stream is not None
                try:
                    self._batch(queries[len(replies) :], replies, whole, counted=not alongside_shell or bool(replies))
                except _FAILURES as error:
                    self._drop()
                    # An engine may close an idle stream just as it is used again; a GET can be repeated.
                    if used and not isinstance(error, EngineGone):
                        continue
                    gone = self._link.failure(_in_words(error), queries[len(replies)].timeout_s)
                    if status := next((code for kind, code in _IS_THERE.items() if isinstance(error, kind)), 0):
                        gone = replace(gone, status=status)
                    replies += [gone] * (len(queries) - len(replies))
            return replies

    def _batch(self, queries: Sequence[EngineQuery], replies: list[Reply], whole: Deadline, *, counted: bool) -> None:
        """Send all requests and add the replies as they come; each has its own time, within that of all."""
        if whole.passed:
            raise EngineLate
        if self._stream is None:
            self._stream = self._link.open(min(_DIAL_S, queries[0].timeout_s))
        stream = self._stream
        self._link.traffic.round_trips += counted
        stream.settimeout(max(_LEAST_S, queries[0].timeout_s))
        stream.sendall(b"".join(_request(query) for query in queries))
        for query in queries:
            stream.settimeout(max(_LEAST_S, min(query.timeout_s, whole.left())))
            # it takes no more of a socket than the method makefile
            answer = http.client.HTTPResponse(stream, method="GET")  # type: ignore[arg-type]
            answer.begin()
            left = _LONGEST_BATCH - sum(len(reply.out) for reply in replies)
            replies.append(_reply(query, answer, min(left, _LONGEST_ANSWER)))
            self.api_version = answer.headers.get("Api-Version", "") or self.api_version
            if answer.will_close:
                self._drop()
                return  # the rest is asked again, on a new stream

    def _drop(self) -> None:
        """Forget the stream."""
        self.close()
        self._stream = None


def _request(query: EngineQuery) -> bytes:
    """Return the bytes of one GET."""
    params = urllib.parse.urlencode(query.params)
    target = quoted(query.path) + (f"?{params}" if params else "")
    return f"GET {target} HTTP/1.1\r\nHost: engine\r\n\r\n".encode("ascii")


def _reply(query: EngineQuery, answer: http.client.HTTPResponse, longest: int) -> Reply:
    """Read the body of an answer whose headers are there.

    Raises:
        _UnreadError: The body is longer than any sensible one, or all of a batch are.
        HTTPException: The body ends too early.
    """
    body = bytearray()
    while piece := answer.read(_PIECE):  # in one piece, memory would be reserved for whatever length the robot claims
        body += piece
        if len(body) > longest:
            most = f"{_LONGEST_ANSWER >> 20} MiB, or all of them together than {_LONGEST_BATCH >> 20} MiB"
            raise _UnreadError(f"the Docker Engine's answer to {query.path} is longer than {most}")
    if answer.length:
        raise http.client.IncompleteRead(b"", answer.length)
    text = body.decode("utf-8", "replace")
    if query.headers:
        text = json.dumps({name.lower(): value for name, value in answer.headers.items()})
    if not 200 <= answer.status < 300:
        return Reply(status=answer.status, out=text, err=message_of(text), ok=False)
    try:
        json_of_robot(text)
    except ValueError as error:
        # a list that is too long to be read must not pass for an empty one: what is in it would be taken for gone
        said = f"the Docker Engine's answer to {query.path} cannot be read: {error}"
        return Reply(status=answer.status, out=text, err=said, ok=False)
    return Reply(status=answer.status, out=text)


def _in_words(error: BaseException) -> BaseException:
    """Return the error; for what is no HTTP at all, one that says so."""
    if not isinstance(error, http.client.HTTPException):
        return error
    said = " ".join(str(error).split())[:200] or type(error).__name__
    return EngineGone(f"what answers is no Docker Engine ({said})")
