"""The end of an interrupted run: running steps have so many seconds, then their connections are closed.

Takes the sessions of a run; tells when the time is over and ends those that are still at work. A robot kills what a
closed connection was running there, and then frees its lock.
"""

from __future__ import annotations

import concurrent.futures
import threading
import time
from collections.abc import Collection, Mapping

from srprov.execution.options import MOST_AT_ONCE
from srprov.execution.outcome import Event, Listener
from srprov.session import Session

LOOK_S = 0.25
"""How often it is looked whether the run was interrupted; nothing wakes a thread that waits for a step."""
CLOSING_S = 5.0
"""For threads to notice that their connection was closed."""


class Ending:
    """Whether running steps still have time, and the robots whose connections were closed when it was over."""

    def __init__(self, stop: threading.Event, patience_s: float, listener: Listener) -> None:
        """Take the event of the interrupt; the time begins when it is first seen to be set."""
        self._stop, self._patience_s, self._listener = stop, patience_s, listener
        self._until: float | None = None
        self.closed: dict[str, str] = {}
        """Robot -> why its steps were not reached."""

    def due(self) -> bool:
        """Return whether the run was interrupted and the time for running steps is over."""
        if self._stop.is_set() and self._until is None:
            self._until = time.monotonic() + self._patience_s
        return self._until is not None and time.monotonic() >= self._until

    def close(self, robots: Collection[str], sessions: Mapping[str, Session]) -> None:
        """Close the connections to these robots, all at once, and wait only for a moment."""
        late = [robot for robot in robots if robot not in self.closed and robot in sessions]
        if not late:
            return
        for robot in late:
            self.closed[robot] = f"interrupted: it did not end within {self._patience_s:g} s, and was cut off"
            self._listener(Event(kind="waiting", host=robot, text="its step did not end: closing the connection"))
        pool = concurrent.futures.ThreadPoolExecutor(min(len(late), MOST_AT_ONCE))
        concurrent.futures.wait([pool.submit(sessions[robot].close) for robot in late], timeout=CLOSING_S)
        pool.shutdown(wait=False)
