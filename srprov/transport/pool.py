"""Sessions with many robots at once; a robot that cannot be reached is a value, and the others do not wait for it.

Takes the inventory's hosts, gives sessions by name. Connecting starts at once, in daemon threads: `get` waits for one
robot only. New connections start at a limited rate beyond a first burst, so that a name server, an access point or a
jump host is not flooded.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Iterable, Mapping
from types import TracebackType

from srprov.definitions.model import Host
from srprov.errors import ConnectError, TransportError, UsageError
from srprov.transport import ConnectOptions, connect
from srprov.transport.session import BaseSession
from srprov.wire import Session

_RATE_PER_S = 40.0


class _Place:
    """What is known of one robot; `done` is set when there is something."""

    __slots__ = ("done", "failure", "session")

    def __init__(self) -> None:
        self.done = threading.Event()
        self.session: Session | None = None
        self.failure: BaseException | None = None


class Sessions:
    """Connects to all hosts when it is made, and closes every connection in the end; a context manager.

    Args:
        hosts: By name, as `Inventory.hosts`.
        options: How to connect.
        forks: How many connections are being made at the same time.
        rate_per_s: How many are begun per second, once `forks` of them have been begun at once.
    """

    def __init__(
        self,
        hosts: Mapping[str, Host],
        *,
        options: ConnectOptions | None = None,
        forks: int = 50,
        rate_per_s: float = _RATE_PER_S,
    ) -> None:
        self._hosts = dict(hosts)
        self._options = options or ConnectOptions()
        self._pace = _Pace(rate_per_s, burst=forks)
        self._places = {name: _Place() for name in self._hosts}
        self._closed = threading.Event()
        self._waiting: queue.SimpleQueue[str] = queue.SimpleQueue()
        for name in self._hosts:
            self._waiting.put(name)
        # No ThreadPoolExecutor: at exit it waits for its threads, and Ctrl-C would wait for the slowest robot.
        for _ in range(min(forks, len(self._hosts))):
            threading.Thread(target=self._work, name="connect", daemon=True).start()

    def _work(self) -> None:
        """Connect to one host after the other until none is left."""
        while not self._closed.is_set():
            try:
                name = self._waiting.get_nowait()
            except queue.Empty:
                return
            self._pace.wait()
            self._connect(name)

    def _connect(self, name: str) -> None:
        """Connect to one host and keep the session, or the reason."""
        place = self._places[name]
        try:
            session = connect(self._hosts[name], options=self._options, peers=self.get)
        except BaseException as error:  # get() raises it where somebody listens
            place.failure = error
        else:
            place.session = session
        place.done.set()
        # close() may have gone by while this one was being made.
        if self._closed.is_set() and place.session is not None:
            place.session.close()

    def get(self, host: str) -> Session:
        """Give the session of one robot, as soon as it is there.

        Raises:
            TransportError: It cannot be reached.
            UsageError: The inventory has no such host.
        """
        if host not in self._places:
            raise UsageError(f"no host {host!r} in the inventory", hint=f"there are: {', '.join(sorted(self._places))}")
        place = self._places[host]
        while not place.done.wait(0.5):
            if self._closed.is_set():
                raise ConnectError(host, "connections were closed", hint="connect again")
        if place.session is not None:
            return place.session
        assert place.failure is not None
        # Each caller gets an error of its own: one that is raised twice would grow its traceback from several threads.
        if isinstance(place.failure, TransportError):
            raise type(place.failure)(host, place.failure.message, hint=place.failure.hint) from place.failure
        raise place.failure

    def connected(self) -> dict[str, Session]:
        """Wait for all robots and give the sessions of those that were reached, in the inventory's order."""
        self._wait()
        return {name: place.session for name, place in self._places.items() if place.session is not None}

    def prepare(self, hosts: Iterable[str]) -> None:
        """Let these robots' sessions get ready to change something, in the background; those not reached are left."""
        for name in hosts:
            session = self._places[name].session
            if isinstance(session, BaseSession):
                session.prepare()

    def failures(self) -> dict[str, TransportError]:
        """Wait for all robots and give the errors of those that were not reached."""
        self._wait()
        return {name: p.failure for name, p in self._places.items() if isinstance(p.failure, TransportError)}

    def _wait(self) -> None:
        """Wait until every robot was tried; a bug met on the way is raised."""
        for name, place in self._places.items():
            try:
                self.get(name)
            except TransportError:
                continue
            if place.session is None:
                raise AssertionError("get() gives a session or raises")

    def close(self) -> None:
        """End every connection, also those that are being made; safe to call twice."""
        self._closed.set()
        for place in self._places.values():
            if place.session is not None:
                place.session.close()

    def __enter__(self) -> Sessions:
        """Give itself."""
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        """Close."""
        self.close()


class _Pace:
    """Lets a first burst through at once and the rest at a rate."""

    def __init__(self, rate_per_s: float, burst: int) -> None:
        self._step = 1.0 / rate_per_s
        self._burst = burst
        self._next = 0.0
        self._lock = threading.Lock()

    def wait(self) -> None:
        """Sleep until it is this caller's turn."""
        with self._lock:
            now = time.monotonic()
            # `_next` may lie behind by as much as a burst takes, never by more.
            self._next = max(self._next, now - self._burst * self._step) + self._step
            pause = self._next - now
        if pause > 0:
            time.sleep(pause)
