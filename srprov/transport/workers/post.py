"""Messages as bytes over one socket: each is sent whole, in the order in which they were put.

One thread alone writes. Whoever has something to say puts it in a queue and goes on: no Ctrl-C leaves half a message
behind, nobody holds a lock while the other end does not read, and a finalizer may speak while a message is being made.
How much is in the queue is for who puts it there to bound.
"""

from __future__ import annotations

import contextlib
import queue
import socket
import struct
import threading
from collections.abc import Iterator

_HEAD = struct.Struct("!Q")


class Post:
    """One end of a socket pair."""

    def __init__(self, sock: socket.socket) -> None:
        """Take the socket, and begin to write."""
        self._socket = sock
        self._file = sock.makefile("rb")
        self._outbox: queue.SimpleQueue[bytes | threading.Event | None] = queue.SimpleQueue()
        threading.Thread(target=self._write, name="post", daemon=True).start()

    def put(self, message: bytes) -> None:
        """Send a message after those before it; one that cannot be sent any more is dropped."""
        self._outbox.put(message)

    def flush(self, seconds: float) -> None:
        """Wait until what was put before is sent, or the seconds are over."""
        sent = threading.Event()
        self._outbox.put(sent)
        sent.wait(seconds)

    def received(self) -> Iterator[bytes]:
        """Yield messages until either end is closed; what is half read then is dropped."""
        with contextlib.suppress(OSError):
            while len(head := self._file.read(_HEAD.size)) == _HEAD.size:
                (size,) = _HEAD.unpack(head)
                if len(message := self._file.read(size)) < size:
                    return
                yield message

    def hang_up(self) -> None:
        """Send and receive nothing more; both ends' readers notice."""
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._outbox.put(None)

    def _write(self) -> None:
        """Send what is in the queue."""
        try:
            while (item := self._outbox.get()) is not None:
                if isinstance(item, threading.Event):
                    item.set()
                else:
                    self._socket.sendall(_HEAD.pack(len(item)) + item)
        except OSError:
            pass  # the reader sees the end, too, and knows more of it
        finally:
            self.hang_up()
