"""Connections with locked robots that may be lost, and are then made and locked anew."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from types import TracebackType

from srprov.codes import Code
from srprov.controller.fleet import Fleet
from srprov.errors import TransportError
from srprov.execution.lock_set import LockOptions, LockSet
from srprov.execution.locks import Claim
from srprov.session import Session


class LockedRobots:
    """Sessions with robots that this run has locked; a context manager that releases the locks that it took itself."""

    def __init__(self, fleet: Fleet, sessions: Mapping[str, Session], claim: Claim, options: LockOptions) -> None:
        """Take sessions whose robots are locked by somebody who releases them."""
        self._fleet, self._claim, self._options = fleet, claim, options
        self._sessions = dict(sessions)
        self._locks: list[LockSet] = []

    def get(self, host: str) -> Session:
        """Return the present session with a robot."""
        return self._sessions[host]

    def renew(self, host: str) -> None:
        """Connect to a robot anew, and lock it.

        Raises:
            TransportError: It cannot be reached.
            LockHeld: Somebody else has locked it meanwhile.
        """
        self._sessions[host].close()
        session = self._fleet.sessions.again(host)
        never = threading.Event()
        locks = LockSet([host], {host: session}, self._claim, self._options, never, lambda event: None).acquire()
        self._locks.append(locks)
        if why := locks.lost.get(host):
            raise TransportError(host, why, code=Code.LOST)
        self._sessions[host] = session

    def __enter__(self) -> LockedRobots:
        """Return itself."""
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        """Release the locks that were taken here."""
        for locks in self._locks:
            locks.release()
