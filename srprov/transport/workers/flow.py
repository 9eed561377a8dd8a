"""Streams that are read ahead a little for another process, which asks for what is there: a log may pause for hours."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import Any

_MOST_AHEAD = 1 << 20
"""Bytes, or characters, that are read ahead of a stream."""


class Flow:
    """A stream with a thread that reads it, to its end or until nobody wants it."""

    def __init__(self, items: Iterator[Any]) -> None:
        """Begin to read."""
        self._items = items
        self._change = threading.Condition()
        self._ready: list[Any] = []
        self._size = 0
        self._over = False
        self._error: BaseException | None = None
        threading.Thread(target=self._read, name="stream", daemon=True).start()

    def some(self) -> list[Any]:
        """Wait for the next items and return those that are there; nothing at the end.

        A quiet stream is waited for as long as somebody wants it: who does not, or is gone, drops it (`Link.end`).

        Raises:
            Exception: What ended the stream, once all that came before was given.
        """
        with self._change:
            self._change.wait_for(lambda: self._ready or self._over)
            ready, self._ready, self._size = self._ready, [], 0
            self._change.notify_all()
            if not ready and self._error is not None:
                raise self._error
        return ready

    def dropped(self) -> None:
        """Read no further."""
        with self._change:
            self._over = True
            self._change.notify_all()

    def _read(self) -> None:
        try:
            try:
                self._read_on()
            finally:
                if (close := getattr(self._items, "close", None)) is not None:
                    close()
        except BaseException as error:  # raised where somebody waits
            self._error = error
        finally:
            self.dropped()

    def _read_on(self) -> None:
        for item in self._items:
            with self._change:
                self._change.wait_for(lambda: self._size < _MOST_AHEAD or self._over)
                if self._over:
                    break
                self._ready.append(item)
                self._size += _length(item)
                self._change.notify_all()


def _length(item: Any) -> int:  # noqa: ANN401 - bytes, a line, or a stream's number with bytes
    return len(item[1] if isinstance(item, tuple) else item) + 1
