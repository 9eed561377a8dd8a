"""A script on a robot that is kept alive by a heartbeat, and a controller that notices when it is not heard any more.

Takes the streams of a session's second shell, implements `session.LockChannel`. A thread sends `b` every few seconds
and waits for its echo. What counts is when the last echoed beat was *sent*: the robot heard it later and waits
longer, so the controller has stopped before the robot's end gives up. The clock is one that goes on while this machine
sleeps, as the robot's does.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from srprov.codes import Code
from srprov.errors import TransportError
from srprov.session import Pulse, Traffic

if TYPE_CHECKING:
    from srprov.session import Streams

_GOODBYE_S = 2.0
_LOCKED = "locked"
"""What the script says once it has the lock."""
_LONGEST = 16 * 1024
"""Bytes of a line; the longest holds what others wrote into the holder's file, of which the script takes 2000."""
_HINT = "is the robot up, and its network? what was running there is ended by the robot itself; apply again"


def now() -> float:
    """Return seconds on a clock that nobody can set and that counts suspended time where the system has one."""
    return time.clock_gettime(time.CLOCK_BOOTTIME) if hasattr(time, "CLOCK_BOOTTIME") else time.monotonic()


class HeartbeatChannel:
    """The controller's end of a lock. One exchange at a time, by whichever thread."""

    def __init__(
        self, host: str, streams: Streams, traffic: Traffic, pulse: Pulse, lost: Callable[[TransportError], None]
    ) -> None:
        """Take the streams of a shell that waits for a command, and whom to tell that the contact is lost."""
        self._host, self._streams, self._traffic, self._pulse, self._lost = host, streams, traffic, pulse, lost
        self._lock = threading.Lock()
        self._over = threading.Event()
        self._heard = now()
        self._received = bytearray()
        self.first_answer = ""
        self._held = False
        self.sshd_pid = ""
        """The connection's process on the robot, which the script ends too; empty if unknown, or when it is over."""

    def open(self, command: str) -> None:
        """Start the script, wait for the line before it and for its first line, and start the heartbeat.

        Raises:
            TransportError: It ended, or said nothing in time.
        """
        try:
            self.sshd_pid = self.send(command + "\n")
            heard = self._heard
            with self._lock:
                self.first_answer = self._exchange("", self._pulse.controller_s)
                self._held = self.first_answer == _LOCKED
                self._heard = heard  # the robot's end has waited since then, however late its words came
        except TransportError:
            self._over.set()
            self._streams.close()
            raise
        threading.Thread(target=self._beat, name=f"heartbeat {self._host}", daemon=True).start()

    def send(self, text: str) -> str:
        """Send a letter and return the line that answers it; one round trip.

        Raises:
            TransportError: The contact is lost.
        """
        with self._lock:
            self._traffic.round_trips += 1
            answer = self._exchange(text, self._pulse.controller_s)
            self._held = answer == _LOCKED or (self._held and text != "f")
            return answer

    @property
    def held(self) -> bool:
        """Whether the robot is locked by this."""
        return self._held and not self._over.is_set()

    def check(self) -> None:
        """Make sure that the robot's end is there, without asking it; a channel that was closed is never lost.

        Raises:
            TransportError: It ended, or was not heard for too long.
        """
        if self._over.is_set():
            return
        if self._lock.acquire(blocking=False):
            # only who reads sees the end; whoever has the lock is reading
            self._received += self._streams.read()[0]
            self._lock.release()
        self._raise_if_endless()
        self._raise_if_lost()

    def close(self) -> None:
        """Send `e`, wait a moment for the script's end and close; safe to call twice."""
        if self._over.is_set():
            return
        self._over.set()
        self.sshd_pid = ""
        if self._lock.acquire(timeout=_GOODBYE_S):
            with contextlib.suppress(TransportError):
                self._exchange("e", min(_GOODBYE_S, self._pulse.controller_s))
            self._lock.release()
        self._streams.close()

    def cut(self) -> None:
        """Close without a word: the robot's end then stops what runs there."""
        self._over.set()
        self.sshd_pid = ""
        self._streams.close()

    def _beat(self) -> None:
        """Send the heartbeat until the channel is closed or nobody answers."""
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
        while b"\n" not in self._received:
            pending = pending[self._streams.write(pending) :] if pending else pending
            out, _ = self._streams.read()
            self._received += out
            self._raise_if_endless()
            if not out:
                self._raise_if_lost()
            left = begun + limit_s - now()
            if left <= 0 and b"\n" not in self._received:  # half a line after the other is no sign of life
                raise self._silent(limit_s)
            if not out:
                self._streams.wait(min(left, 1.0), writing=bool(pending))
        line, _, rest = bytes(self._received).partition(b"\n")
        self._received = bytearray(rest)
        self._heard = begun
        return line.decode("utf-8", "replace")

    def _raise_if_endless(self) -> None:
        """Raise when more is said than letters were asked."""
        if len(self._received) > _LONGEST:
            message = f"lost contact: more than {_LONGEST >> 10} KiB came where one line was expected"
            raise TransportError(
                self._host, message, hint="look at the robot: its shell answers as none of srprov's", code=Code.ANSWER
            )

    def _raise_if_lost(self) -> None:
        """Raise when the robot's end is gone or silent for too long."""
        if self._streams.ended:
            raise TransportError(self._host, f"lost contact: {self._streams.reason()}", hint=_HINT, code=Code.LOST)
        if now() - self._heard > self._pulse.controller_s:
            raise self._silent(self._pulse.controller_s)

    def _silent(self, seconds: float) -> TransportError:
        return TransportError(
            self._host, f"lost contact: no sign of life for {seconds:g} s", hint=_HINT, code=Code.LOST
        )
