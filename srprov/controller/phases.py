"""The clock of a run: seconds per phase."""

from __future__ import annotations

import time
from collections.abc import Mapping


class Phases:
    """Seconds per phase, from one clock."""

    def __init__(self) -> None:
        """Begin with what happens before the first named phase."""
        self.begun = self._last = time.monotonic()
        self._name = "definitions"
        self.seconds: dict[str, float] = {}

    def begin(self, phase: str) -> None:
        """End the current phase and begin the next."""
        now = time.monotonic()
        self.seconds[self._name] = self.seconds.get(self._name, 0.0) + now - self._last
        self._name, self._last = phase, now

    def end(self) -> Mapping[str, float]:
        """Return seconds per phase, in order."""
        self.begin("end")
        return {name: round(seconds, 3) for name, seconds in self.seconds.items()}

    @property
    def total(self) -> float:
        """Seconds since the beginning."""
        return time.monotonic() - self.begun
