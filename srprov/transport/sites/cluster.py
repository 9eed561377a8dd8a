"""Processes at sites, started by the workers of a Dask cluster that are there.

Takes a scheduler's address; gives a `Program` per site. Dask places one actor on the one worker that has a resource of
the site's name, and never elsewhere; nothing is run a second time. The bytes go to that worker directly, not through
the scheduler, and no task of the cluster has an argument but the hash of srprov's files.
"""

from __future__ import annotations

import contextlib
import secrets
import threading
from concurrent.futures import Future
from typing import Any

from srprov.transport.background import background
from srprov.transport.sites import settings
from srprov.transport.sites.carrier import Carrier
from srprov.transport.sites.outpost import Outpost, WrongProgram
from srprov.transport.workers.program import SiteError

_START_S = 60.0
"""For a worker to start a process, its imports included."""
_CLOSE_S = 3.0
_LATE_S = 5.0
"""Longer than Dask itself waits for a connection."""


class Cluster:
    """A scheduler's cluster, connected to when the first process is wanted."""

    def __init__(self, address: str, timeout_s: float) -> None:
        """Take its address, and how long it may take to answer.

        Raises:
            RefusedError: It would be spoken to without TLS.
            UsageError: It is no address, Dask is not installed, or certificates are missing.
        """
        self._address, self._timeout_s = settings.checked_address(address), timeout_s
        self._security = settings.security("client")
        self._lock = threading.Lock()
        self._client: Future[Any] | None = None
        self._closed = threading.Event()

    def start(self, site: str) -> SiteProgram:
        """Start a process at a site.

        Raises:
            SiteError: The scheduler does not answer, no worker is at the site, or it cannot start one.
        """
        client = self._connected()
        address = self._worker_at(client, site)
        made = client.submit(
            Outpost, settings.program_digest(), actor=True, workers=[address], allow_other_workers=False, retries=0,
            pure=False, key=f"srprov-{site}-{secrets.token_hex(8)}",
        )  # fmt: skip
        try:
            return SiteProgram(site, made, made.result(timeout=_START_S))
        except WrongProgram as error:
            raise SiteError(f"site {site}: {error}", "install the same srprov here and there") from None
        except Exception as error:  # whatever Dask or the site raises
            why = f"{type(error).__name__}: {error}"[:300]
            raise SiteError(f"site {site}: its worker at {address} starts no process: {why}", _START_AGAIN) from None

    def close(self) -> None:
        """Leave the cluster. One that does not answer is waited for a moment, one that has not answered yet is not."""
        with self._lock:
            self._closed.set()
            client, self._client = self._client, None
        if client is not None and client.done() and client.exception() is None:
            closing = threading.Thread(target=_closed, args=(client.result(),), name="close cluster", daemon=True)
            closing.start()
            closing.join(_CLOSE_S)

    def _connected(self) -> Any:  # noqa: ANN401 - a client of a library that is imported late
        """Return the client. Who asks first connects; the others wait for that, and get the same error."""
        with self._lock:
            if self._closed.is_set():
                raise SiteError("connections were closed", "connect again")
            first = self._client is None
            client = self._client = self._client or Future()
        if first:
            try:
                client.set_result(self._connect())
            except BaseException as error:  # raised where somebody waits
                client.set_exception(error)
        if first and self._closed.is_set():
            _closed(client.result())
        return client.result()

    def _connect(self) -> Any:  # noqa: ANN401 - as `_connected`
        distributed = settings.import_distributed()
        # its own timeout is for a connection alone: one on which nothing is said then is waited for without end
        made = background(
            lambda: distributed.Client(
                self._address, security=self._security, timeout=self._timeout_s, direct_to_workers=True, name="srprov"
            )
        )
        try:
            return made.result(self._timeout_s + _LATE_S)
        except Exception as error:  # whatever Dask raises for what answers there
            if not made.done():
                made.add_done_callback(_closed_when_made)
            raise self._unreachable(error) from None

    def _unreachable(self, error: Exception) -> SiteError:
        why = settings.reason(error) or f"no answer within {self._timeout_s:g} s"
        return SiteError(f"the scheduler {self._address} cannot be reached: {why}", _SCHEDULER)

    def _worker_at(self, client: Any, site: str) -> str:  # noqa: ANN401 - as `_connected`
        """Return the address of the worker that is at a site: of several, the one whose name comes first."""
        try:  # not `scheduler_info`: it waits for the scheduler without a deadline
            known = client.sync(client.scheduler.identity, n_workers=-1, callback_timeout=self._timeout_s)
        except Exception as error:  # as in `_connect`
            raise self._unreachable(error) from None
        workers = known["workers"]
        found = sorted((str(one["name"]), str(at)) for at, one in workers.items() if site in one["resources"])
        if not found:
            others = sorted({name for one in workers.values() for name in one["resources"]})
            there = f"sites with one: {', '.join(others)[:200]}" if others else "no site has one"
            raise SiteError(
                f"no worker of site {site} is connected to {self._address}; {there}",
                f"start one there: srprov worker --site {site} --engine {self._address}",
            )
        _, address = found[0]
        return address


class SiteProgram:
    """A process at a site; a `Program`."""

    def __init__(self, site: str, future: object, actor: Any) -> None:  # noqa: ANN401 - see `Carrier`
        """Take where it is; the future keeps the actor alive."""
        self.name = f"the worker of site {site}"
        self._future, self._actor = future, actor
        self._carrier = Carrier(actor)
        self.socket = self._carrier.socket

    def wait(self, seconds: float) -> str:
        """Wait for its end, which is brought about, and say how it came."""
        try:
            return str(self._actor.end().result(timeout=max(seconds, 1.0)))
        except Exception:  # whatever Dask raises for a worker that is gone
            return f"cannot be reached any more{self._carrier.why}"
        finally:
            self._carrier.hang_up()

    def kill(self) -> None:
        """Give it up; its worker ends it when nobody asks for it any more."""
        self._carrier.hang_up()


_START_AGAIN = "look at what `srprov worker` says there, and start it again"
_SCHEDULER = "is it running, and are its certificates of the same authority? See docs/sites.md"


def _closed_when_made(client: Future[Any]) -> None:
    """Leave a cluster that answered when nobody waited for it any more."""
    if client.exception() is None:
        background(lambda: _closed(client.result()))


def _closed(client: Any) -> None:  # noqa: ANN401 - as `_connected`
    with contextlib.suppress(Exception):  # the cluster may be gone
        client.close(timeout=_CLOSE_S)
