"""HTTP to a Docker Engine over any pair of byte streams: the part that requests and urllib3 have to be taught.

Takes a function that dials the engine (an SSH channel running `docker system dial-stdio`, or a Unix socket), gives an
adapter for the docker SDK's `APIClient`. docker's own `transport/sshconn.py` shows the seams; it opens an SSH
connection of its own, knows no deadline and loses what the far end wrote to stderr.
"""

from __future__ import annotations

import contextlib
import io
import threading
from collections.abc import Callable
from typing import Any, Protocol

import requests.adapters
import urllib3
import urllib3.connection

from srprov.transport.deadline import Deadline
from srprov.wire import Traffic

MAX_CHANNELS = 4
"""sshd's MaxSessions is 10 by default, and the shell needs one."""
_POOL_WAIT_S = 300.0
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


class _Connection(urllib3.connection.HTTPConnection):
    """One HTTP connection to the engine, kept alive."""

    def __init__(self, dial: Dial) -> None:
        super().__init__("engine")
        self._dial = dial

    def connect(self) -> None:
        seconds = float(self.timeout) if isinstance(self.timeout, (int, float)) else 60.0
        sock = self._dial(seconds)
        sock.settimeout(seconds)
        self.sock = sock  # http.client uses no more of a socket than this one has

    def request(self, *args: Any, **kwargs: Any) -> None:  # noqa: ANN401 - as the base class has it
        # A connection that is used again still has the deadline of its last request.
        if self.sock is not None:
            self.sock.settimeout(self.timeout)
        super().request(*args, **kwargs)

    @property
    def is_connected(self) -> bool:
        # The base class selects on fileno(), which costs a paramiko channel two descriptors.
        sock: Any = self.sock
        return sock is not None and not sock.waiting()


class _Pool(urllib3.HTTPConnectionPool):
    """At most four connections; a fifth request waits for one of them."""

    def __init__(self, dial: Dial) -> None:
        super().__init__("engine", maxsize=MAX_CHANNELS, block=True)
        self._dial = dial

    def _new_conn(self) -> _Connection:
        return _Connection(self._dial)

    def _get_conn(self, timeout: float | None = None) -> Any:  # noqa: ANN401 - as the base class has it
        return super()._get_conn(timeout=timeout or _POOL_WAIT_S)


class EngineAdapter(requests.adapters.HTTPAdapter):
    """A requests adapter whose only destination is the engine behind `dial`."""

    def __init__(self, dial: Dial, traffic: Traffic) -> None:
        """Take how to open a stream, and where to count requests."""
        super().__init__()
        self._pool = _Pool(dial)
        self._traffic = traffic

    def get_connection_with_tls_context(self, *_args: object, **_kwargs: object) -> _Pool:
        """Give the one pool; requests calls this since 2.32.2, and `get_connection` before."""
        return self._pool

    get_connection = get_connection_with_tls_context

    def request_url(self, request: requests.PreparedRequest, proxies: Any) -> str:  # noqa: ANN401
        """Give the path alone, whatever proxy the environment names."""
        return request.path_url

    def send(self, *args: Any, **kwargs: Any) -> requests.Response:  # noqa: ANN401 - as the base class has it
        """Count and send."""
        self._traffic.round_trips += 1
        return super().send(*args, **kwargs)

    def close(self) -> None:
        """Close every idle connection."""
        super().close()
        self._pool.close()


def root_cause(error: BaseException) -> BaseException:
    """Give the error at the bottom: requests wraps urllib3, which wraps what the stream raised."""
    seen: set[int] = set()
    found: BaseException | None = error
    while found is not None and id(found) not in seen:
        seen.add(id(found))
        if isinstance(found, (EngineGone, TimeoutError)):
            return found
        inner = [a for a in getattr(found, "args", ()) if isinstance(a, BaseException)]
        found = inner[0] if inner else (getattr(found, "reason", None) or found.__cause__ or found.__context__)
        if found is not None and not isinstance(found, BaseException):
            break
    return error
