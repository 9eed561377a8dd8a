"""Whether the link to a robot is so fast that compressing what goes over it costs more time than it saves.

`gzip -1` makes 20 to 80 MiB/s on a core of a robot. So a link counts as fast if it takes, or gives, 256 KiB within
10 ms (25 MiB/s, 210 Mbit/s), measured once for each robot and run. The best of some tries counts, as a busy machine
only makes them longer; the first two fill what buffers on the way let through at once, and do not count. Whatever is
unclear is slow.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Mapping
from types import MappingProxyType

from srprov.session import Session, Streams

_BYTES = 256 << 10
_MOST_S = 0.01
_TRIES = 8
_UNCOUNTED = 2
_TOGETHER_S = 0.5
_READY_S = 5.0


class Links:
    """What was measured, each once. Safe for several threads."""

    def __init__(self, known: Mapping[tuple[str, str], bool] = MappingProxyType({})) -> None:
        """Take what is known: (`gives` or `takes`, robot) -> whether it is fast."""
        self._lock = threading.Lock()
        self._turns: dict[tuple[str, str], threading.Lock] = {}
        self._known = dict(known)

    def gives_fast(self, session: Session) -> bool:
        """Return whether what a robot sends arrives fast; raises TransportError when it cannot be talked to."""
        return self._once("gives", session, f"head -c {_BYTES} /dev/urandom", 0, _BYTES)

    def takes_fast(self, session: Session) -> bool:
        """Return whether a robot gets fast what is sent; raises as `gives_fast` does."""
        return self._once("takes", session, f"head -c {_BYTES} | wc -c", _BYTES, len(f"{_BYTES}\n"))

    def _once(self, way: str, session: Session, act: str, size: int, wanted: int) -> bool:
        """Measure it unless it is known: `wanted` bytes answer `size` bytes that are sent."""
        key = way, session.host
        with self._lock:
            turn = self._turns.setdefault(key, threading.Lock())
        with turn:  # others need not wait for this robot
            if key not in self._known:
                streams = session.open_shell(f"echo ready; while read -r _; do {act}; done")
                try:
                    # random bytes, as a connection may compress
                    self._known[key] = _is_fast(streams, b"go\n" + os.urandom(size), wanted)
                finally:
                    streams.close()
            return self._known[key]


def _is_fast(streams: Streams, send: bytes, wanted: int) -> bool:
    if _exchanged(streams, b"", len("ready\n"), _READY_S) is None:
        return False
    left = _TOGETHER_S
    for number in range(_TRIES):
        took = _exchanged(streams, send, wanted, left)
        if took is None:
            return False
        if number >= _UNCOUNTED and took <= _MOST_S:
            return True
        left -= took
    return False


def _exchanged(streams: Streams, send: bytes, wanted: int, seconds: float) -> float | None:
    """Send this, and return the seconds until so many bytes have come; None when they do not come in time."""
    began, rest, got = time.monotonic(), memoryview(send), 0
    while got < wanted and (left := began + seconds - time.monotonic()) > 0 and not streams.ended:
        sent, came = streams.write(rest) if rest else 0, len(streams.read()[0])
        rest, got = rest[sent:], got + came
        if not sent and not came:
            streams.wait(left, writing=bool(rest))
    return time.monotonic() - began if got >= wanted else None
