"""Who gets a content first, when several robots need it: the others wait, and find it there then."""

from __future__ import annotations

import threading
from contextlib import AbstractContextManager
from typing import Any, Protocol


class Turns(Protocol):
    """Something that lets one at a time get each content."""

    def turn(self, key: str) -> AbstractContextManager[Any]:
        """Return a block that waits until nobody else gets this content."""


class OwnTurns:
    """Turns among the threads of this process."""

    def __init__(self) -> None:
        """Begin with nobody."""
        self._lock = threading.Lock()
        self._turns: dict[str, threading.Lock] = {}

    def turn(self, key: str) -> threading.Lock:
        """Return the lock of one content; whichever thread may release it."""
        with self._lock:
            return self._turns.setdefault(key, threading.Lock())
