"""A byte stream to a Docker Engine, and what all who use one share: one deadline, one way to open it, errors in words.

Takes an SSH channel, or a Unix socket of this machine; returns an `EngineSocket` for `http.client`. Its errors are not
OSErrors on purpose: urllib3 and requests wrap those, and would have to be asked for the cause again.
"""

from __future__ import annotations

import contextlib
import io
import threading
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import msgspec

from srprov.codes import Code
from srprov.errors import TransportError
from srprov.pace import LEAST_RATE
from srprov.session import Traffic
from srprov.transport.deadline import Deadline
from srprov.wire import Reply

if TYPE_CHECKING:
    import socket

    import paramiko

    Stream = paramiko.Channel | socket.socket

_PIECE = 32 * 1024
_READ = 64 * 1024
_WRITING = 1
"""`socket.SHUT_WR`."""
_BOTH_WAYS = 2
"""`socket.SHUT_RDWR`, which paramiko's channels take too."""


class EngineGone(Exception):
    """There is no engine at the far end; the text says why."""


class EngineLate(EngineGone):
    """The engine did not answer within its time."""


class WaitInAll(float):
    """A timeout of all waits together, which bytes give back (`srprov/pace.py`); a reader's time is its own."""


class EngineSocket:
    """A stream as `http.client` wants its socket; `settimeout` starts one deadline for all that follows."""

    def __init__(self, stream: Stream, complaint: Callable[[], str], waiting: Callable[[], bool]) -> None:
        """Take the stream, a way to learn why it ended, and one to see whether bytes or its end are waiting."""
        self._stream = stream
        self._complaint = complaint
        self.waiting = waiting
        self._deadline: Deadline | None = None
        self._waits: WaitInAll | None = None
        self._left = 0.0
        self._reader = _Reader(self)
        self._answers = 0
        self._closed = False
        self._lock = threading.Lock()

    def settimeout(self, seconds: float | None) -> None:
        """Allow so many seconds for everything from now on together, or for the waits alone."""
        self._waits = seconds if isinstance(seconds, WaitInAll) else None
        self._left = self._waits or 0.0
        self._deadline = None if seconds is None or self._waits is not None else Deadline(seconds)

    @contextlib.contextmanager
    def _in_time(self) -> Iterator[Stream]:
        """Lend the stream for one call, which ends with the deadline.

        Raises:
            EngineLate: The deadline is over.
        """
        left = self._deadline.left() if self._deadline else self._left if self._waits is not None else None
        if left is not None and left <= 0:
            raise EngineLate
        self._stream.settimeout(left if left is None else max(left, 0.001))
        began = time.monotonic()
        try:
            yield self._stream
        except TimeoutError:
            raise EngineLate from None
        finally:
            self._left -= time.monotonic() - began

    def sendall(self, data: bytes) -> None:
        """Send everything, or raise EngineGone with the reason."""
        view = memoryview(data)
        while view:
            try:
                with self._in_time() as stream:
                    sent = stream.send(bytes(view[:_PIECE]))
            except OSError as error:
                raise EngineGone(self._complaint() or f"the connection to the engine broke: {error}") from error
            if not sent:
                raise EngineGone(self._complaint() or "the connection to the engine was closed")
            self.give_back(sent)
            view = view[sent:]

    def close_writing(self) -> None:
        """Let the other end see that nothing more will come."""
        with contextlib.suppress(OSError, EOFError):
            self._stream.shutdown(_WRITING)

    def recv_into(self, buffer: Any) -> int:  # noqa: ANN401 - a writable buffer
        """Receive into a buffer; 0 at the end."""
        with self._in_time() as stream:
            data = stream.recv(min(len(buffer), 1 << 20))
        if not data and (why := self._complaint()):
            raise EngineGone(why)
        buffer[: len(data)] = data
        return len(data)

    def give_back(self, size: int) -> None:
        """Count bytes of content, which give a wait for all together some time back; headers and trailers are none."""
        if self._waits is not None:
            self._left = min(self._waits, self._left + size / LEAST_RATE)

    def makefile(self, _mode: str = "rb") -> io.BufferedReader:
        """Return the one reader: what is left in it when an answer ends is the beginning of the next."""
        with self._lock:
            self._answers += 1
        return self._reader

    def answer_read(self) -> None:
        """Count an answer that nobody reads any more."""
        with self._lock:
            self._answers -= 1
        self._close_unused()

    def close(self) -> None:
        """Close, once the last answer is read: http.client closes its socket while that is still being done."""
        self._closed = True
        self._close_unused()

    def _close_unused(self) -> None:
        if self._closed and self._answers <= 0:
            self.abort()

    def abort(self) -> None:
        """Close at once, whoever reads: that ends their wait."""
        self._closed = True
        with contextlib.suppress(OSError, EOFError):
            self._stream.shutdown(_BOTH_WAYS)  # closing a socket does not wake who reads from it
        with contextlib.suppress(OSError, EOFError):
            self._stream.close()


class _Raw(io.RawIOBase):
    """The reading half of a socket. It has no `settimeout`: the docker SDK would use it to switch the deadline off."""

    def __init__(self, owner: EngineSocket) -> None:
        super().__init__()
        self._owner = owner

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:  # noqa: ANN401 - as the base class has it
        return self._owner.recv_into(buffer)


class _Reader(io.BufferedReader):
    """A buffered reader that outlives the answers read from it."""

    def __init__(self, owner: EngineSocket) -> None:
        super().__init__(_Raw(owner), 256 * 1024)
        self._owner = owner

    def read(self, size: int | None = -1, /) -> bytes:
        """Return so many bytes; whoever asks for fewer than none was told so by the engine, as a chunk's length.

        http.client passes that on, and would keep all that comes until the connection ends.

        Raises:
            EngineGone: The size is none.
        """
        if size is None or size < 0:
            raise EngineGone("it sends pieces of a length that is none")
        parts: list[bytes] = []
        while size > 0 and (piece := self.read1(min(size, _READ))):
            parts.append(piece)
            size -= len(piece)
        return b"".join(parts)

    def read1(self, size: int = -1, /) -> bytes:
        """Return what is here; http.client reads content so, and all else by lines."""
        piece = super().read1(size)
        self._owner.give_back(len(piece))
        return piece

    def readinto(self, buffer: Any, /) -> int:  # noqa: ANN401 - as the base class has it
        """Fill a buffer, which is how http.client of Python 3.10 reads content."""
        size = super().readinto(buffer)
        self._owner.give_back(size)
        return size

    def close(self) -> None:
        self._owner.answer_read()


Dial = Callable[[float], EngineSocket]
"""Opens a stream to the engine within so many seconds; raises EngineGone in words, or TimeoutError."""


class EngineLink(msgspec.Struct, frozen=True, kw_only=True):
    """How the engine of one robot is reached."""

    host: str
    """The robot's name."""
    dial: Dial
    alive: Callable[[], bool]
    """Tells whether the robot itself can still be talked to."""
    traffic: Traffic
    """Where requests are counted."""

    def open(self, seconds: float) -> EngineSocket:
        """Dial within so many seconds.

        Raises:
            EngineGone: It says in words what is in the way.
        """
        try:
            return self.dial(seconds)
        except TimeoutError:
            raise EngineLate from None

    def failure(self, error: BaseException, seconds: float) -> Reply:
        """Return the reply for an engine that does not answer as it should.

        Raises:
            TransportError: The whole robot is gone.
        """
        if not self.alive():
            hint = "is the robot up, and its network?"
            raise TransportError(self.host, "the connection was lost", hint=hint, code=Code.LOST) from error
        if isinstance(error, EngineLate):
            return Reply(status=0, ok=False, err=f"the Docker Engine did not answer within {seconds:g} s")
        words = " ".join(str(error).split())[:500]
        return Reply(status=0, ok=False, err=words or "the Docker Engine closed the connection")
