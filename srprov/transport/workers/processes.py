"""Worker processes: each robot's connection is in one of them, by a hash of its name.

Takes the way to any session; gives `FarSession`s. A worker that ends takes its connections with it: its robots cannot
be reached from then on, and nobody starts another one, since what it was doing is not known. The robots free their
locks by themselves.
"""

from __future__ import annotations

import contextlib
import logging
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from srprov.session import Session
from srprov.transport.turns import OwnTurns
from srprov.transport.workers.counting import shard
from srprov.transport.workers.far import lost
from srprov.transport.workers.far_session import FarSession
from srprov.transport.workers.link import ROOT, Link, LinkLost
from srprov.transport.workers.post import Post
from srprov.transport.workers.served import act

if TYPE_CHECKING:
    from srprov.definitions.model import Host
    from srprov.transport.options import ConnectOptions

_CONNECT_S = 600.0
"""A worker has deadlines of its own for a connection, all of them shorter."""
_SILENT_S = 60.0
"""A worker that answers no ping for so long is killed: its robots are given up rather than waited for without end."""
_ENDING_S = 6.0
"""A little longer than a worker takes to close connections."""
_LOOK_S = 1.0
"""How often who waits for a turn looks whether the worker is still there."""
_SENT = ("connect_timeout_s", "attempts", "ssh_config", "warm_engine")
"""Fields of `ConnectOptions` that a worker is told; the others are its own, or lent."""
_log = logging.getLogger(__name__)


class Workers:
    """The processes of one run, started when this is made."""

    def __init__(self, count: int, options: ConnectOptions, get: Callable[[str], Session]) -> None:
        """Take how many, how they connect, and what gives the session of any robot."""
        self._options, self._get = options, get
        self._turns = OwnTurns()
        self._workers: list[_Worker] = []
        try:
            for number in range(count):
                self._workers.append(_Worker(self.home(number, count), number))
        except BaseException:
            self.close()
            raise

    def connect(self, host: Host) -> FarSession:
        """Connect to a robot; raises as `srprov.transport.connect` does."""
        options = {key: getattr(self._options, key) for key in _SENT}
        link = self._workers[shard(host.name, len(self._workers))].link
        limit_s = max(_CONNECT_S, 3 * self._options.connect_timeout_s)
        try:
            handle = link.call(ROOT, "connect", host, options, limit_s=limit_s)
            return FarSession(link, handle, host.name, self._options.vault)
        except LinkLost as error:
            raise lost(host.name, error) from None

    def home(self, number: int, count: int) -> _Home:
        """Return what one worker of so many may call."""
        return _Home(self._get, self._turns, lambda host: shard(host, count) == number)

    def close(self) -> None:
        """End all of them, and their connections; safe to call twice."""
        for worker in self._workers:
            worker.link.end("connections were closed")
        until = time.monotonic() + _ENDING_S
        for worker in self._workers:
            worker.wait(until)


class _Home:
    """What a worker may call: sessions that other workers have, and turns among all of them."""

    def __init__(self, get: Callable[[str], Session], turns: OwnTurns, own: Callable[[str], bool]) -> None:
        self._get, self._turns, self._own = get, turns, own
        self._lock = threading.Lock()
        self._taken: set[str] = set()
        self._gone = threading.Event()

    def peer(self, host: str) -> Session | None:
        """Wait until a robot is connected; return its session, or None when the worker that asks has it."""
        session = self._get(host)
        return None if self._own(host) else session

    def take_turn(self, key: str) -> None:
        """Let the worker get a content alone."""
        turn = self._turns.turn(key)
        while not turn.acquire(timeout=_LOOK_S):
            if self._gone.is_set():
                return
        with self._lock:
            self._taken.add(key)
        if self._gone.is_set():
            self.give_turn(key)

    def give_turn(self, key: str) -> None:
        """Let the next one."""
        with self._lock:
            if key not in self._taken:
                return  # it was given when the worker ended
            self._taken.remove(key)
        self._turns.turn(key).release()

    def gone(self) -> None:
        """Let the next one in everything that the worker had."""
        self._gone.set()
        with self._lock:
            taken = list(self._taken)
        for key in taken:
            self.give_turn(key)


class _Worker:
    """One process."""

    def __init__(self, home: _Home, number: int) -> None:
        self._home = home
        ours, theirs = socket.socketpair()
        # no secret and no robot's name: everything else comes over the socket
        start = f"import sys; sys.path[:] = {sys.path!r}; from srprov.transport.workers.worker import main; "
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-c", f"{start}main({theirs.fileno()})"],
                stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, pass_fds=[theirs.fileno()],
                start_new_session=True,  # Ctrl-C is for this process, which ends what has to end
            )  # fmt: skip
        self.link = Link(Post(ours), self._home, act, _log.warning)
        for work in (self._run, self.link.beat, lambda: self.link.watch(self._silent)):
            threading.Thread(target=work, name=f"worker {number}", daemon=True).start()

    def wait(self, until: float) -> None:
        """Wait for its end, which was asked for, and see to it."""
        try:
            self._process.wait(max(0.0, until - time.monotonic()))
        except subprocess.TimeoutExpired:
            self._kill()

    def _kill(self) -> None:
        self._process.kill()
        with contextlib.suppress(subprocess.TimeoutExpired):  # what the kernel does not let end, nobody waits for
            self._process.wait(_ENDING_S)

    def _run(self) -> None:
        """Read what it says; when it is gone, so are its robots."""
        try:
            self.link.run()
        finally:
            how = "hung up"
            try:
                if not self.link.over.is_set():
                    how = self._how_it_ended()
            finally:  # whatever came of that: who waits for it is told now
                self.link.end(f"the worker process of this robot {how}")
                self._home.gone()

    def _how_it_ended(self) -> str:
        """See to its end, and say how it came."""
        try:
            code = self._process.wait(_ENDING_S)
        except subprocess.TimeoutExpired:
            self._kill()
            return "hung up"
        if code >= 0:
            return f"ended with {code}"
        known = {one.value: one.name for one in signal.Signals}
        return f"was ended by {known.get(-code, f'signal {-code}')}"

    def _silent(self, seconds: float) -> None:
        if seconds >= _SILENT_S:
            self._process.kill()
