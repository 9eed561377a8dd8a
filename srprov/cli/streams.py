"""Standard streams that survive: output that cannot be written ends no run.

A full disk, a reader that went away, a terminal that was closed: the first error of a stream is kept, and what is
written later is dropped. Replaces `sys.stdout` and `sys.stderr`, once, when the program begins.
"""

from __future__ import annotations

import errno
import io
import os
import select
import sys
from typing import Any, TextIO

_STANDARD = (0, 1, 2)


class _Surviving(io.FileIO):
    """A file descriptor that takes everything; `lost` is why it does not reach anybody any more."""

    lost: OSError | None = None

    def write(self, data: Any, /) -> int:  # noqa: ANN401 - any buffer, whose type has a name for type checkers only
        try:
            while self.lost is None:
                if (written := super().write(data)) is not None:
                    return written
                select.select([], [self], [])  # somebody who shares the terminal does not want to wait; we do
        except OSError as error:
            self.lost = error
        return memoryview(data).nbytes


def protect_standard_streams() -> None:
    """Let standard output and standard error survive, and open what is closed: no connection may get its number."""
    for descriptor in _STANDARD:
        try:
            os.fstat(descriptor)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # gets the lowest number that is free
    sys.stdin = sys.stdin or io.TextIOWrapper(io.BufferedReader(io.FileIO(0, closefd=False)))
    sys.stdout, sys.stderr = surviving(1, sys.stdout), surviving(2, sys.stderr)


def surviving(descriptor: int, stream: TextIO | None) -> TextIO:
    """Return a stream like another one that writes to a file descriptor and never raises for it.

    Args:
        descriptor: Where to write; stays open.
        stream: Its encoding and buffering are taken over. None stands for a stream that was closed: it is lost.
    """
    raw = _Surviving(descriptor, "w", closefd=False)
    buffer = io.BufferedWriter(raw)
    if not isinstance(stream, io.TextIOWrapper):
        raw.lost = OSError(errno.EBADF, os.strerror(errno.EBADF))
        return io.TextIOWrapper(buffer, encoding="utf-8", errors="backslashreplace")
    return io.TextIOWrapper(
        buffer,
        encoding=stream.encoding,
        errors=stream.errors,
        line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    )


def reader_left(stream: TextIO) -> bool:
    """Return whether nobody will read a stream any more, found out without writing to it; it is lost then."""
    raw = getattr(getattr(stream, "buffer", None), "raw", None)
    if not isinstance(raw, _Surviving):
        return False
    if raw.lost is None:
        look = select.poll()
        look.register(raw.fileno(), 0)
        if any(about & (select.POLLERR | select.POLLHUP | select.POLLNVAL) for _, about in look.poll(0)):
            raw.lost = BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE))
    return raw.lost is not None


def lost(stream: TextIO) -> OSError | None:
    """Return why a stream cannot be written any more, or None."""
    raw = getattr(getattr(stream, "buffer", None), "raw", None)
    return raw.lost if isinstance(raw, _Surviving) else None
