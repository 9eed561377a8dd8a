"""How long a stream of a stranger is waited for: who falls silent or trickles ends it, and a slow radio does not.

One rule for whatever carries content: results, volumes, layers, data sets, logs. Touches only the monotonic clock.
"""

from __future__ import annotations

import time

SILENCE_S = 120.0
LEAST_RATE = 2 << 10
"""bytes/s: a third of what a radio of 50 kbit/s carries, so that it may also drop out now and then."""


TOO_LITTLE = f"nothing, or next to nothing, for {SILENCE_S:g} s"
"""What a stream gave that is not waited for any longer, in words."""


class Pace:
    """A time to wait that content gives back at `LEAST_RATE`, and never more than the time at the beginning.

    So a stream is silent for at most that long, and content of N bytes comes within that and N / `LEAST_RATE`. Only
    bytes that are content may be counted: an endless header gives nothing back.
    """

    __slots__ = ("_at", "_left", "_most")

    def __init__(self, seconds: float = SILENCE_S) -> None:
        """Take the seconds, from now on."""
        self._most = self._left = seconds
        self._at = time.monotonic()

    def goes_on(self, size: int) -> bool:
        """Count bytes of content that came or went since the last call, or 0; return whether there is time left."""
        now = time.monotonic()
        self._left = min(self._most, self._left - (now - self._at) + size / LEAST_RATE)
        self._at = now
        return self._left > 0

    def resume(self) -> None:
        """Leave out the time since the last call: it was not the stream's."""
        self._at = time.monotonic()

    def extend(self, seconds: float) -> None:
        """Wait longer: there is something to be done that takes so long."""
        self._most += seconds
        self._left += seconds

    @property
    def left(self) -> float:
        """Seconds that are left."""
        return self._left - (time.monotonic() - self._at)
