"""How far a copy is: bytes done, rate, and what is left, as lines of progress."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator

from srprov.session import Progress

_STEP = 8 << 20
_EVERY_S = 1.0
_TELLING_S = 2.0
"""Before that the rate tells more of buffers than of the link."""


class Meter:
    """Counts the bytes of one copy, and tells so after every 8 MiB and every second."""

    def __init__(self, what: str, progress: Progress, total: int = 0) -> None:
        """Take what is copied, whom to tell, and how many bytes there are; 0: nobody knows."""
        self._what, self._progress, self._total = what, progress, total
        self._said = 0.0
        self.begin(0)

    def begin(self, done: int) -> None:
        """Start with so many bytes that are there already."""
        self._done = self._before = self._next = done
        self._began = time.monotonic()

    def count(self, pieces: Iterable[bytes]) -> Iterator[bytes]:
        """Pass pieces on."""
        for piece in pieces:
            yield piece
            self.add(len(piece))
        self._progress(self.text())

    def add(self, size: int) -> None:
        """Count bytes that went by."""
        self._done += size
        now = time.monotonic()
        if self._done >= self._next or now - self._said >= _EVERY_S:
            self._next, self._said = self._done + _STEP, now
            self._progress(self.text())

    def grow(self, size: int) -> None:
        """Expect so many bytes more."""
        self._total += size

    def text(self) -> str:
        """Say how far it is."""
        seconds = max(time.monotonic() - self._began, 0.001)
        rate = (self._done - self._before) / seconds
        words = f"{self._what}: {mib(self._done)}" + (f" of {mib(self._total)}" if self._total else "")
        words += f" MiB copied, {mib(rate)} MiB/s"
        if self._total > self._done and rate and seconds >= _TELLING_S:
            words += f", {(self._total - self._done) / rate:.0f} s left"
        return words


def mib(size: float) -> str:
    """Return bytes as MiB."""
    return f"{size / (1 << 20):.1f}"
