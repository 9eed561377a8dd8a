"""A command in a running container, with its streams: the engine's exec API over a connection of its own.

Takes an `EngineLink` and an `Exec`; gives a `ContainerCommand`. The command travels as JSON: no shell sees its words.

Source: Docker Engine API 1.41, "Exec".
"""

from __future__ import annotations

import http.client
import json
import re
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from srprov.codes import Code
from srprov.errors import TransportError
from srprov.failure import why
from srprov.transport.engine.answers import message_of, quoted
from srprov.transport.engine.link import EngineGone, EngineLink
from srprov.untrusted import integer, json_or_none, mapping, string
from srprov.wire import EngineCall, EngineQuery, Reply

if TYPE_CHECKING:
    from srprov.session import Exec

_START_S = 20.0
_ENDING_S = 10.0
"""For an engine to know the code of a command whose streams have ended."""
_PIECE = 64 * 1024
_HEADER = 8
_LONGEST_ANSWER = 1 << 20
_CREATED = 201
_UPGRADED = (101, 200)
_ID = re.compile("[0-9a-f]{64}")
_FAILURES = (EngineGone, http.client.HTTPException, OSError, EOFError, ValueError)


Ask = Callable[[Sequence[EngineQuery]], Sequence[Reply]]
Call = Callable[[EngineCall], Reply]


class AttachedCommand:
    """A `session.ContainerCommand`: one thread may read, another may write."""

    def __init__(self, link: EngineLink, ask: Ask, call: Call, container: str, what: Exec) -> None:
        """Start the command.

        Args:
            link: How its engine is reached.
            ask: Asks that engine.
            call: Changes something there.
            container: The container's name.
            what: The command.

        Raises:
            TransportError: It cannot be run there, in the engine's words; or the engine or the robot is gone.
        """
        self._link, self._ask, self._call, self._framed = link, ask, call, not what.terminal
        self._writing = threading.Lock()
        try:
            self._stream = link.open(_START_S)
            try:
                self._stream.settimeout(_START_S)
                self._id = self._create(container, what)
                self._start(what)
            except BaseException:
                self._stream.abort()
                raise
        except _FAILURES as error:
            raise self._failed(f"no command can be run in {container}", error) from error
        self._stream.settimeout(None)

    def _create(self, container: str, what: Exec) -> str:
        """Tell the engine what is to be run; return the id that it gives it."""
        answer = self._post(f"/containers/{container}/exec", what.body())
        text = answer.read(_LONGEST_ANSWER + 1).decode("utf-8", "replace")
        if answer.status != _CREATED:
            raise EngineGone(message_of(text) or f"status {answer.status}")
        number = string(mapping(json_or_none(text)).get("Id"))
        if not _ID.fullmatch(number) or len(text) > _LONGEST_ANSWER:
            raise EngineGone("its engine gave it no id")
        return number

    def _start(self, what: Exec) -> None:
        """Start it; the stream is the command's from then on."""
        body = {"Detach": False, "Tty": what.terminal}
        answer = self._post(f"/exec/{self._id}/start", body, "Connection: Upgrade\r\nUpgrade: tcp\r\n")
        if answer.status not in _UPGRADED:
            raise EngineGone(message_of(answer.read(_LONGEST_ANSWER).decode("utf-8", "replace")) or "it refuses")

    def _post(self, path: str, body: Mapping[str, Any], more: str = "") -> http.client.HTTPResponse:
        """Send a request and return the answer, of which only the head was read."""
        data = json.dumps(body).encode("ascii")
        head = (
            f"POST {quoted(path)} HTTP/1.1\r\nHost: engine\r\n{more}Content-Type: application/json\r\n"
            f"Content-Length: {len(data)}\r\n\r\n"
        )
        self._link.traffic.round_trips += 1
        self._stream.sendall(head.encode("ascii") + data)
        # it takes no more of a socket than the method makefile
        answer = http.client.HTTPResponse(self._stream, method="POST")  # type: ignore[arg-type]
        answer.begin()
        return answer

    def _failed(self, what: str, error: BaseException) -> TransportError:
        said = self._link.failure(error, _START_S).err
        hint = "srprov status says what runs where"
        if "is not running" in said:
            hint = "srprov logs says what it printed, srprov start starts it again"
        return TransportError(self._link.host, f"{what}: {said}", hint=hint, code=Code.COMMAND)

    def output(self) -> Iterator[tuple[int, bytes]]:
        """Yield what the command writes as it comes, each with 1 or 2 for its stream, until it ends.

        Raises:
            TransportError: The engine or the robot is gone.
        """
        source = self._stream.makefile()
        try:
            if not self._framed:
                while piece := source.read1(_PIECE):
                    yield 1, piece
                return
            while header := source.read(_HEADER):
                if len(header) < _HEADER:
                    raise EngineGone("the connection to the engine was closed")
                if header[0] > 2 or header[1:4] != b"\0\0\0":
                    raise EngineGone("what it sends of a command has no form")
                left = int.from_bytes(header[4:], "big")
                while left:
                    if not (piece := source.read1(min(left, _PIECE))):
                        raise EngineGone("the connection to the engine was closed")
                    left -= len(piece)
                    yield max(1, header[0]), piece
        except _FAILURES as error:
            raise self._failed("the command's output ended", error) from error

    def write(self, data: bytes) -> None:
        """Send to the command's standard input; what cannot be sent is dropped, since it has ended then."""
        with self._writing:
            try:
                self._stream.sendall(data)
            except _FAILURES:
                return

    def close_input(self) -> None:
        """Let the command see the end of its standard input."""
        with self._writing:
            self._stream.close_writing()

    def resize(self, rows: int, columns: int) -> None:
        """Tell the command's terminal its size; one that has ended already has none."""
        size = (("h", str(rows)), ("w", str(columns)))
        self._call(EngineCall(method="POST", path=f"/exec/{self._id}/resize", params=size))

    def exit_code(self) -> int | None:
        """Return the code of a command whose output has ended; None when it was never run.

        Raises:
            TransportError: The engine does not know it.
        """
        until = time.monotonic() + _ENDING_S
        while True:
            (reply,) = self._ask([EngineQuery(path=f"/exec/{self._id}/json")])
            found = mapping(reply.json()) if reply.ok else {}
            if found and found.get("Running") is not True:
                code = integer(found.get("ExitCode"), high=255, default=255)
                return code if integer(found.get("Pid"), high=1 << 32) or not code else None
            if time.monotonic() > until:
                said = "it still runs" if found else why(reply)
                raise TransportError(self._link.host, f"the command's code is not known: {said}", code=Code.COMMAND)
            time.sleep(0.05)

    def close(self) -> None:
        """Let go of its streams; the command may go on."""
        self._stream.abort()
