"""Worker processes: each robot's connection is in one of them, by a hash of its name, or by the site that it is at.

Takes the way to any session; gives `FarSession`s. A worker that ends takes its connections with it: its robots cannot
be reached from then on, and nobody starts another one, since what it was doing is not known. The robots free their
locks by themselves.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Protocol

from srprov.codes import Code
from srprov.errors import ConnectError
from srprov.session import Session
from srprov.transport.turns import OwnTurns
from srprov.transport.workers.counting import shard
from srprov.transport.workers.far import lost
from srprov.transport.workers.far_session import FarSession
from srprov.transport.workers.home import Home
from srprov.transport.workers.link import ROOT, Link, LinkLost
from srprov.transport.workers.post import Post
from srprov.transport.workers.program import LocalProgram, Program, SiteError
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
_SENT = ("connect_timeout_s", "attempts", "ssh_config", "warm_engine")
"""Fields of `ConnectOptions` that a worker is told; the others are its own, or lent."""
_log = logging.getLogger(__name__)


class Sites(Protocol):
    """What starts a process at a site; see `sites/cluster.py`."""

    def start(self, site: str) -> Program:
        """Start one.

        Raises:
            SiteError: There is nobody at that site to do so.
        """

    def close(self) -> None:
        """Start none any more."""


class Workers:
    """The processes of one run: those of this machine, started when this is made, and those of sites."""

    def __init__(
        self, hosts: Mapping[str, Host], options: ConnectOptions, get: Callable[[str], Session], *, count: int,
        sites: Sites | None,
    ) -> None:  # fmt: skip
        """Start those of this machine.

        Args:
            hosts: All robots.
            options: How to connect.
            get: Returns the session of any robot.
            count: Processes of this machine, for robots that are at no site; 0: this one connects to those.
            sites: Starts processes elsewhere; None: all robots are reached from here.
        """
        self._hosts, self._options, self._get = hosts, options, get
        self._count, self._starter = count, sites
        self._closed = threading.Event()
        self._sites: dict[str, _Worker | SiteError] = {}
        self._begun = OwnTurns()
        self._workers: list[_Worker] = []
        turns = OwnTurns()
        try:
            for number in range(count):
                self._workers.append(_Worker(LocalProgram(), self._home(number, turns)))
        except BaseException:
            self.close()
            raise

    def has(self, host: str) -> bool:
        """Return whether a worker is to connect to this robot."""
        return bool(self._count or self._site(host))

    def connect(self, host: Host) -> FarSession:
        """Connect to a robot; raises as `srprov.transport.connect` does."""
        options = {key: getattr(self._options, key) for key in _SENT}
        limit_s = max(_CONNECT_S, 3 * self._options.connect_timeout_s)
        link = self._worker(host.name).link
        try:
            handle = link.call(ROOT, "connect", host, options, limit_s=limit_s)
            return FarSession(link, handle, host.name, self._options.vault)
        except LinkLost as error:
            raise lost(host.name, error) from None

    def close(self) -> None:
        """End all of them, and their connections; safe to call twice."""
        self._closed.set()
        every = [*self._workers, *(one for one in list(self._sites.values()) if isinstance(one, _Worker))]
        for worker in every:
            worker.link.end("connections were closed")
        until = time.monotonic() + _ENDING_S
        for worker in every:
            worker.program.wait(max(0.0, until - time.monotonic()))
        if self._starter is not None:
            self._starter.close()

    def _site(self, host: str) -> str:
        """Return the site by which a robot is reached; nothing when that is this machine."""
        return self._hosts[host].site if self._starter is not None else ""

    def _home(self, process: int | str, turns: OwnTurns) -> Home:
        """Return what one process may call here; it is the one of a number, or of a site."""
        return Home(self._get, lambda host: self.has(host) and self._whose(host) == process, turns, self._options)

    def _whose(self, host: str) -> int | str:
        return self._site(host) or shard(host, self._count)

    def _worker(self, host: str) -> _Worker:
        """Return the process that is for a robot, started if it is the first of a site.

        Raises:
            ConnectError: It is at a site where none can be started.
        """
        site = self._site(host)
        if not site:
            return self._workers[shard(host, self._count)]
        with self._begun.turn(site):
            if site not in self._sites:
                self._sites[site] = self._started(site)
        found = self._sites[site]
        if isinstance(found, SiteError):
            raise ConnectError(host, found.message, hint=found.hint, code=Code.SITE)
        return found

    def _started(self, site: str) -> _Worker | SiteError:
        assert self._starter is not None
        try:
            worker = _Worker(self._starter.start(site), self._home(site, OwnTurns()))
        except SiteError as error:
            return error
        if self._closed.is_set():
            worker.link.end("connections were closed")
        return worker


class _Worker:
    """One process."""

    def __init__(self, program: Program, home: Home) -> None:
        self.program, self._home = program, home
        self.link = Link(Post(program.socket), home, act, _log.warning)
        for work in (self._run, self.link.beat, lambda: self.link.watch(self._silent)):
            threading.Thread(target=work, name="worker", daemon=True).start()

    def _run(self) -> None:
        """Read what it says; when it is gone, so are its robots."""
        try:
            self.link.run()
        finally:
            how = "hung up"
            try:
                if not self.link.over.is_set():
                    how = self.program.wait(_ENDING_S)
            finally:  # whatever came of that: who waits for it is told now
                self.link.end(f"{self.program.name} {how}")
                self._home.gone()

    def _silent(self, seconds: float) -> None:
        if seconds >= _SILENT_S:
            self.program.kill()
