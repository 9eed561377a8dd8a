"""Moments by which something must be done, shared by all the steps that lead there.

Takes seconds, returns seconds; touches nothing but the monotonic clock.
"""

from __future__ import annotations

import time

BATCH_S = 300.0
"""Beyond the longest time of a single one, for the answers to many questions together: a robot that takes nearly all of
its time for each would be waited for by all others for hours."""
SLOWEST = 64 * 1024
"""bytes/s of the slowest link that an answer's length is allowed time for."""


class Deadline:
    """A moment in the future: `Deadline(10)` is ten seconds from now."""

    __slots__ = ("at", "seconds")

    def __init__(self, seconds: float) -> None:
        """Take the seconds from now."""
        self.seconds = seconds
        self.at = time.monotonic() + seconds

    def left(self, floor: float = 0.0) -> float:
        """Return the seconds that are left, at least `floor`."""
        return max(floor, self.at - time.monotonic())

    @property
    def passed(self) -> bool:
        """Tell whether the moment is over."""
        return time.monotonic() >= self.at


class Patience:
    """A time to wait for an answer, and as much more as its bytes take on a slow link; a trickle does not extend it."""

    __slots__ = ("_at",)

    def __init__(self, seconds: float) -> None:
        """Take the seconds from now."""
        self._at = time.monotonic() + seconds

    def moved(self, size: int) -> None:
        """Count bytes that were sent or received."""
        self._at += size / SLOWEST

    def left(self) -> float:
        """Return the seconds that are left."""
        return self._at - time.monotonic()
