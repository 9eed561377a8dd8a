"""What a session gives while it stays in another process: streams, shells, locks and commands, called from here."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator
from typing import Any, cast

from srprov.codes import Code
from srprov.errors import TransportError
from srprov.session import Progress, no_progress
from srprov.transport.workers.link import Link, LinkLost
from srprov.transport.workers.sealed import Handle

_PIECE = 256 << 10
"""Bytes that are offered to a shell there at once; it takes what fits."""
_QUICK = frozenset(("traffic", "measure", "prepare", "read", "ended", "reason", "close", "close_input", "resize"))
"""What takes no time there. The rest has deadlines of its own there, or waits for what has none, as a quiet log."""
QUICK_S = 60.0
_HINT = "apply again: nothing that was begun there is done a second time by itself"


class Far:
    """Something in another process that belongs to one robot."""

    def __init__(self, link: Link, handle: Handle, host: str) -> None:
        self._link, self._handle, self._host = link, handle, host

    def _call(self, method: str, *words: Any, progress: Progress = no_progress, **named: Any) -> Any:  # noqa: ANN401 - of any method
        limit_s = QUICK_S if method in _QUICK else math.inf
        try:
            return self._link.call(self._handle.number, method, *words, progress=progress, limit_s=limit_s, **named)
        except LinkLost as error:
            raise lost(self._host, error) from None


def lost(host: str, error: LinkLost) -> TransportError:
    """Return the error of a robot whose connection ended with its process."""
    return TransportError(host, f"lost contact: {error}", hint=_HINT, code=Code.LOST)


class FarItems(Far):
    """A stream of the other process, read to its end or until nobody wants it."""

    def __init__(self, link: Link, handle: Handle, host: str = "") -> None:
        """Take where it is; `host` is whose, for the error when that process is gone."""
        super().__init__(link, handle, host)

    def __iter__(self) -> Iterator[Any]:
        """Yield its items as they come."""
        try:
            while items := self._call("some"):
                yield from items
        finally:
            self._link.drop(self._handle)


class FarStreams(Far):
    """A shell of another process; one whose process is gone has ended, as one that was closed has."""

    def __init__(self, link: Link, handle: Handle, host: str) -> None:
        """Take where it is."""
        super().__init__(link, handle, host)
        self._why = ""

    def write(self, data: memoryview) -> int:
        """Send what fits now; 0 when nothing does."""
        return int(self._unless_over("write", 0, bytes(data[:_PIECE])))

    def read(self) -> tuple[bytes, bytes]:
        """Return what is here of standard output and of standard error."""
        return cast("tuple[bytes, bytes]", self._unless_over("read", (b"", b"")))

    def wait(self, seconds: float, *, writing: bool) -> None:
        """Sleep until something can be read, or written when `writing`, or the seconds are over."""
        self._unless_over("wait", None, seconds, writing=writing)

    @property
    def ended(self) -> bool:
        """Tell whether nothing will come any more and all of it was read."""
        return bool(self._unless_over("ended", True))

    def reason(self) -> str:
        """Say why it ended."""
        found = str(self._unless_over("reason", ""))
        return found or self._why

    def close(self) -> None:
        """End the shell; safe to call twice and from any thread."""
        self._unless_over("close", None)
        self._why = self._why or "it was closed here"
        self._link.drop(self._handle)

    def _unless_over(self, method: str, over: object, *words: Any, **named: Any) -> Any:  # noqa: ANN401 - of any method
        """Call a method; of a shell that is over, return what is true of it then."""
        if self._why:
            return over
        try:
            return self._call(method, *words, **named)
        except TransportError as error:
            self._why = error.message
            return over


class FarLockChannel(Far):
    """The lock of a robot, whose heart beats in the process that has its connection."""

    def __init__(self, link: Link, handle: Handle, host: str, first_answer: str) -> None:
        """Take where it is, and what the script said by itself."""
        super().__init__(link, handle, host)
        self.first_answer = first_answer

    def send(self, letter: str, /) -> str:
        """Send one letter and return the line that answers it; TransportError when the contact is lost."""
        return str(self._call("send", letter))

    def close(self) -> None:
        """Send `e` and wait a moment for the script's end; safe to call twice, and never raises."""
        with contextlib.suppress(TransportError):
            self._call("close")


class FarCommand(Far):
    """A command in a container of a robot."""

    def output(self) -> Iterator[tuple[int, bytes]]:
        """Yield what it writes as it comes, each with 1 or 2 for its stream, until it ends."""
        return iter(FarItems(self._link, self._call("output"), self._host))

    def write(self, data: bytes) -> None:
        """Send to its standard input; what cannot be sent is dropped, since it has ended then."""
        with contextlib.suppress(TransportError):
            self._call("write", data)

    def close_input(self) -> None:
        """Let it see the end of its standard input."""
        with contextlib.suppress(TransportError):
            self._call("close_input")

    def resize(self, rows: int, columns: int) -> None:
        """Tell its terminal the size."""
        with contextlib.suppress(TransportError):
            self._call("resize", rows, columns)

    def exit_code(self) -> int | None:
        """Return its code, 0 to 255, once its output has ended; None when it was never run."""
        return cast("int | None", self._call("exit_code"))

    def close(self) -> None:
        """Let go of its streams; it may go on."""
        with contextlib.suppress(TransportError):
            self._call("close")
