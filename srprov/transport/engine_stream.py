"""A stream to a Docker Engine, as HTTP clients want their socket: an SSH channel, or a Unix socket of this machine.

Takes a pair of byte streams, gives an `EngineSocket` with one deadline for everything that follows.
"""

from __future__ import annotations

import contextlib
import io
import threading
from collections.abc import Callable
from typing import Any, Protocol

from srprov.transport.deadline import Deadline

_PIECE = 32 * 1024


class EngineGone(OSError):
    """There is no engine at the far end; the text says why."""


class Stream(Protocol):
    """What a paramiko channel and a socket have in common."""

    def settimeout(self, seconds: float | None, /) -> None:
        """Limit each of the following calls."""
        ...

    def recv(self, size: int, /) -> bytes:
        """Receive; none at the end."""
        ...

    def send(self, data: bytes, /) -> int:
        """Send some."""
        ...

    def close(self) -> None:
        """Close."""
        ...


class EngineSocket:
    """A stream as `http.client` wants its socket; `settimeout` starts one deadline for all that follows."""

    def __init__(self, stream: Stream, complaint: Callable[[], str], waiting: Callable[[], bool]) -> None:
        """Take the stream, a way to learn why it ended, and one to see whether bytes or its end are waiting."""
        self._stream = stream
        self._complaint = complaint
        self.waiting = waiting
        self._deadline: Deadline | None = None
        self._readers = 0
        self._closed = False
        self._lock = threading.Lock()

    def settimeout(self, seconds: float | None) -> None:
        """Give everything from now on so many seconds together."""
        self._deadline = None if seconds is None else Deadline(seconds)

    def _arm(self) -> None:
        """Hand what is left of the deadline to the stream."""
        if self._deadline is None:
            self._stream.settimeout(None)
        elif self._deadline.passed:
            raise TimeoutError("timed out")
        else:
            self._stream.settimeout(self._deadline.left(0.001))

    def sendall(self, data: bytes) -> None:
        """Send everything, or raise EngineGone with the reason."""
        view = memoryview(data)
        while view:
            self._arm()
            try:
                sent = self._stream.send(bytes(view[:_PIECE]))
            except TimeoutError:
                raise
            except OSError as error:
                raise EngineGone(self._complaint() or f"the connection to the engine broke: {error}") from error
            if not sent:
                raise EngineGone(self._complaint() or "the connection to the engine was closed")
            view = view[sent:]

    def recv_into(self, buffer: Any) -> int:  # noqa: ANN401 - a writable buffer
        """Receive into a buffer; 0 at the end."""
        self._arm()
        data = self._stream.recv(min(len(buffer), 1 << 20))
        if not data and (why := self._complaint()):
            raise EngineGone(why)
        buffer[: len(data)] = data
        return len(data)

    def makefile(self, _mode: str = "rb", *_args: object, **_kwargs: object) -> io.BufferedReader:
        """Give a buffered reader; the stream stays open until it is closed too."""
        with self._lock:
            self._readers += 1
        return io.BufferedReader(_Raw(self), 256 * 1024)

    def close(self) -> None:
        """Close, once the last reader is done: http.client closes the socket while an answer is still being read."""
        self._closed = True
        self._close_unused()

    def abort(self) -> None:
        """Close at once, whoever reads: that ends their wait."""
        self._closed = True
        with contextlib.suppress(OSError, EOFError):
            self._stream.close()

    def _reader_closed(self) -> None:
        """Count a reader that is done."""
        with self._lock:
            self._readers -= 1
        self._close_unused()

    def _close_unused(self) -> None:
        """Close the stream when nobody uses it any more."""
        if self._closed and self._readers <= 0:
            with contextlib.suppress(OSError, EOFError):
                self._stream.close()


class _Raw(io.RawIOBase):
    """The reading half of an `EngineSocket`."""

    def __init__(self, owner: EngineSocket) -> None:
        super().__init__()
        self._owner: EngineSocket | None = owner

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:  # noqa: ANN401 - as the base class has it
        if self._owner is None:
            raise ValueError("read of a closed stream")
        return self._owner.recv_into(buffer)

    def close(self) -> None:
        owner, self._owner = self._owner, None
        if owner is not None:
            owner._reader_closed()
        super().close()


Dial = Callable[[float], EngineSocket]
"""Opens a stream to the engine within so many seconds; raises EngineGone in words, or TimeoutError."""
