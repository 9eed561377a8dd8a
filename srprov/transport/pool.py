"""Sessions with many robots at once; a robot that cannot be reached is a value, and the others do not wait for it.

Takes the inventory's hosts, returns sessions by name. Connecting starts at once, in daemon threads: `get` waits for one
robot only. New connections start at a limited rate beyond a first burst, so that a name server, an access point or a
jump host is not flooded.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Iterable, Mapping
from concurrent.futures import Future
from concurrent.futures import TimeoutError as NotYet
from types import TracebackType
from typing import TYPE_CHECKING

from srprov.codes import Code
from srprov.definitions.model import Host
from srprov.errors import ConnectError, TransportError, UsageError
from srprov.session import Preparing, Session
from srprov.transport import ConnectOptions, connect

if TYPE_CHECKING:
    from srprov.transport.workers.processes import Workers

RATE_PER_S = 40.0


class Sessions:
    """Connects to all hosts when it is made, and closes every connection in the end; a context manager.

    Args:
        hosts: By name, as `Inventory.hosts`.
        options: How to connect.
        forks: How many connections are being made at the same time.
        rate_per_s: How many are begun per second, once `forks` of them have been begun at once.
        workers: Processes that have the connections; 1: this one. Forks and rate are those of all together.
        scheduler: Of the cluster by which robots at sites are reached; empty: they are reached from here too.
    """

    def __init__(
        self,
        hosts: Mapping[str, Host],
        *,
        options: ConnectOptions | None = None,
        forks: int = 50,
        rate_per_s: float = RATE_PER_S,
        workers: int = 1,
        scheduler: str = "",
    ) -> None:
        self._hosts = dict(hosts)
        self._options = options or ConnectOptions()
        self._workers = self._started(workers, scheduler)
        self._pace = _Pace(rate_per_s, burst=forks)
        self._sessions: dict[str, Future[Session]] = {name: Future() for name in self._hosts}
        self._closed = threading.Event()
        self._waiting: queue.SimpleQueue[str] = queue.SimpleQueue()
        for name in self._hosts:
            self._waiting.put(name)
        # No ThreadPoolExecutor: at exit it waits for its threads, and Ctrl-C would wait for the slowest robot.
        for _ in range(min(forks, len(self._hosts))):
            threading.Thread(target=self._work, name="connect", daemon=True).start()

    def _started(self, workers: int, scheduler: str) -> Workers | None:
        """Start the worker processes of this machine; None when neither they nor those of sites are wanted."""
        at_sites = bool(scheduler) and any(host.site for host in self._hosts.values())
        if workers == 1 and not at_sites:
            return None
        from srprov.transport.workers.processes import Workers

        sites = None
        if at_sites:
            from srprov.transport.sites.cluster import Cluster

            sites = Cluster(scheduler, self._options.connect_timeout_s)
        count = workers if workers > 1 else 0
        return Workers(self._hosts, self._options, self.get, count=count, sites=sites)

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
        try:
            session = self._opened(name)
        except BaseException as error:  # raised where somebody waits
            self._sessions[name].set_exception(error)
            return
        self._sessions[name].set_result(session)
        # close() may have gone by while this one was being made.
        if self._closed.is_set():
            session.close()

    def _opened(self, name: str) -> Session:
        """Connect to one host, here or in the worker that is for it."""
        if self._workers is not None and self._workers.has(name):
            return self._workers.connect(self._hosts[name])
        return connect(self._hosts[name], options=self._options, peers=self.get)

    def get(self, host: str) -> Session:
        """Return the session of one robot, as soon as it is there.

        Raises:
            TransportError: It cannot be reached.
            UsageError: The inventory has no such host.
        """
        if host not in self._sessions:
            raise UsageError(
                f"no host {host!r} in the inventory",
                hint=f"there are: {', '.join(sorted(self._hosts))}",
                code=Code.NO_MATCH,
            )
        failure = self._failure(host)
        if failure is None:
            return self._sessions[host].result()
        # Each caller gets an error of its own: one that is raised twice would grow its traceback from several threads.
        if isinstance(failure, TransportError):
            raise type(failure)(host, failure.message, code=failure.code, hint=failure.hint) from failure
        raise failure

    def _failure(self, host: str) -> BaseException | None:
        """Wait for one robot; return why it cannot be reached, or None."""
        while True:
            try:
                return self._sessions[host].exception(timeout=0.5)
            except NotYet:
                if self._closed.is_set():
                    return ConnectError(host, "connections were closed", hint="connect again", code=Code.LOST)

    def again(self, host: str) -> Session:
        """Connect anew to a robot whose connection was lost, and return the new session.

        Raises:
            TransportError: It cannot be reached.
        """
        session = self._opened(host)
        fresh: Future[Session] = Future()
        fresh.set_result(session)
        self._sessions[host] = fresh
        if self._closed.is_set():
            session.close()
        return session

    def awaited(self) -> list[str]:
        """Return the robots that a connection is still being made to, in the inventory's order."""
        return [name for name, one in self._sessions.items() if not one.done()]

    def connected(self) -> dict[str, Session]:
        """Wait for all robots and return the sessions of those that were reached, in the inventory's order."""
        failures = self.failures()
        return {name: self.get(name) for name in self._hosts if name not in failures}

    def failures(self) -> dict[str, TransportError]:
        """Wait for all robots and return the errors of those that were not reached; a bug met on the way is raised."""
        failures: dict[str, TransportError] = {}
        for name in self._hosts:
            failure = self._failure(name)
            if isinstance(failure, TransportError):
                failures[name] = failure
            elif failure is not None:
                raise failure
        return failures

    def prepare(self, hosts: Iterable[str]) -> None:
        """Let these robots' sessions get ready to change something, in the background; those not reached are left."""
        for session in self._there(hosts):
            if isinstance(session, Preparing):
                session.prepare()

    def _there(self, hosts: Iterable[str]) -> list[Session]:
        """Return the sessions that are there by now."""
        done = [self._sessions[name] for name in hosts if self._sessions[name].done()]
        return [one.result() for one in done if one.exception() is None]

    def close(self) -> None:
        """End every connection, also those that are being made; safe to call twice."""
        self._closed.set()
        workers = self._workers
        for session in self._there(name for name in self._hosts if workers is None or not workers.has(name)):
            session.close()
        if workers is not None:
            workers.close()

    def __enter__(self) -> Sessions:
        """Return itself."""
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
