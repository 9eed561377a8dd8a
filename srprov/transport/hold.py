"""A script on a robot that is kept alive by a heartbeat, and a controller that notices when it is not heard any more.

Takes the streams of a fresh `sh` beside the session's own, gives a `wire.Hold`. A thread sends `b` every few seconds
and waits for its echo. What counts is when the last echoed beat was *sent*: the robot heard it later, and waits longer,
so that the controller has stopped before the robot's end gives up. Time is measured by a clock that goes on while this
machine sleeps, for the robot's goes on then too.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable

from srprov.errors import TransportError
from srprov.transport.shell import Streams
from srprov.wire import Pulse, Traffic

_GOODBYE_S = 2.0
_HINT = "is the robot up, and its network? what was running there is ended by the robot itself; apply again"


def now() -> float:
    """Give seconds on a clock that nobody can set and that counts suspended time where the system has one."""
    return time.clock_gettime(time.CLOCK_BOOTTIME) if hasattr(time, "CLOCK_BOOTTIME") else time.monotonic()


class Heartbeat:
    """Implements `wire.Hold`. One exchange at a time, by whichever thread."""

    def __init__(
        self, host: str, streams: Streams, traffic: Traffic, pulse: Pulse, lost: Callable[[TransportError], None]
    ) -> None:
        """Take the streams of a shell that waits for a command, and whom to tell that the contact is lost."""
        self._host, self._streams, self._traffic, self._pulse, self._lost = host, streams, traffic, pulse, lost
        self._lock = threading.Lock()
        self._over = threading.Event()
        self._heard = now()
        self._line = bytearray()
        self.first = ""
        self.line = ""
        """The process of the connection on the robot, which the script ends too; empty if unknown, or nobody does."""

    def begin(self, command: str) -> None:
        """Start the script, wait for the line before it and for its first line, and let the heart beat.

        Raises:
            TransportError: It ended, or said nothing in time.
        """
        try:
            self.line = self._ask(command + "\n")
            heard = self._heard
            with self._lock:
                self.first = self._exchange("", self._pulse.controller_s)
                self._heard = heard  # the robot's end has waited since then, however late its words came
        except TransportError:
            self._over.set()
            self._streams.close()
            raise
        threading.Thread(target=self._beat, name=f"heartbeat {self._host}", daemon=True).start()

    def say(self, letter: str) -> str:
        """Send one letter and give the line that answers it.

        Raises:
            TransportError: The contact is lost.
        """
        return self._ask(letter)

    def check(self) -> None:
        """Make sure that the robot's end is there, without asking it; a hold that was closed is never lost.

        Raises:
            TransportError: It ended, or was not heard for too long.
        """
        if self._over.is_set():
            return
        if self._lock.acquire(blocking=False):
            # only who reads sees the end; whoever has the lock is reading
            self._line += self._streams.read()[0]
            self._lock.release()
        self._judge()

    def close(self) -> None:
        """Say `e`, wait a moment for the end and close; safe to call twice."""
        if self._over.is_set():
            return
        self._over.set()
        self.line = ""
        if self._lock.acquire(timeout=_GOODBYE_S):
            with contextlib.suppress(TransportError):
                self._exchange("e", min(_GOODBYE_S, self._pulse.controller_s))
            self._lock.release()
        self._streams.close()

    def cut(self) -> None:
        """Close without a word: the robot's end then stops what runs there."""
        self._over.set()
        self.line = ""
        self._streams.close()

    def _ask(self, text: str) -> str:
        """Send, wait for the answer, and count it."""
        with self._lock:
            self._traffic.round_trips += 1
            return self._exchange(text, self._pulse.controller_s)

    def _beat(self) -> None:
        """Be the heart, until the end or until nobody answers."""
        while not self._over.wait(self._pulse.beat_s):
            try:
                with self._lock:
                    if not self._over.is_set():
                        self._exchange("b", self._pulse.controller_s)
            except TransportError as error:
                if not self._over.is_set():
                    self._over.set()
                    self._lost(error)

    def _exchange(self, text: str, limit_s: float) -> str:
        """Write, and read one line. The wait is bounded by the last echo too, not only from now on."""
        begun = now()
        pending = memoryview(text.encode())
        while b"\n" not in self._line:
            pending = pending[self._streams.write(pending) :] if pending else pending
            out, _ = self._streams.read()
            self._line += out
            if out:
                continue
            self._judge()
            if (left := begun + limit_s - now()) <= 0:
                raise self._silent(limit_s)
            self._streams.wait(min(left, 1.0), writing=bool(pending))
        line, _, rest = bytes(self._line).partition(b"\n")
        self._line = bytearray(rest)
        self._heard = begun
        return line.decode("utf-8", "replace")

    def _judge(self) -> None:
        """Raise when the robot's end is gone or silent for too long."""
        if self._streams.ended:
            raise TransportError(self._host, f"lost contact: {self._streams.reason()}", hint=_HINT)
        if now() - self._heard > self._pulse.controller_s:
            raise self._silent(self._pulse.controller_s)

    def _silent(self, seconds: float) -> TransportError:
        return TransportError(self._host, f"lost contact: no sign of life for {seconds:g} s", hint=_HINT)
