"""A site's worker: a worker of a Dask cluster that starts a process of srprov for each run that asks for one.

Takes the site's name and the scheduler's address. It has the site's SSH keys, known hosts and cache of layers, as the
user who runs it; and whoever has a certificate of the cluster can run programs as that user: so does Dask.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import signal
import socket
import tempfile
from collections.abc import Awaitable, Callable
from typing import Any

import msgspec

from srprov.codes import Code
from srprov.errors import RefusedError, SrprovError, UsageError
from srprov.transport.sites import settings

_ANSWER_S = 30.0
"""For the scheduler to answer."""
_KNOCK_S = 20.0
"""Shorter, since its own error says more than that there was no answer."""
_CLOSE_S = 10.0
_OWN_ADDRESS = (errno.EADDRINUSE, errno.EADDRNOTAVAIL, errno.EACCES)
"""Errors of listening, not of the scheduler."""


class SiteLost(SrprovError):
    """The scheduler is gone, or was never there; whoever watches over this program starts it again."""

    exit_code = 4


class Serving(msgspec.Struct, frozen=True, kw_only=True):
    """What a site's worker is told."""

    site: str
    scheduler: str
    host: str = ""
    """Address that those who run experiments reach; empty: the one by which the scheduler is reached."""
    port: int = 0
    """Where it listens; 0: the system chooses."""


def serve(serving: Serving, ready: Callable[[str], None]) -> None:
    """Serve until a signal asks for the end.

    Args:
        serving: What to serve.
        ready: Is told the worker's address, once it can be used.

    Raises:
        RefusedError: The scheduler's address is one without TLS, or the site has a worker.
        UsageError: Dask is not installed, certificates are missing, or nobody can listen at this address.
        SiteLost: The scheduler cannot be reached, or cannot any more.
    """
    settings.checked_address(serving.scheduler)
    security = settings.security("worker")
    distributed = settings.import_distributed()
    import dask

    with (
        dask.config.set({"distributed.worker.http.routes": []}),
        tempfile.TemporaryDirectory(prefix="srprov-") as folder,
    ):
        asyncio.run(_served(distributed, security, serving, folder, ready))


async def _served(
    distributed: Any, security: Any, serving: Serving, folder: str, ready: Callable[[str], None]  # noqa: ANN401 - Dask's
) -> None:  # fmt: skip
    asked = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, asked.set)
    stopping = asyncio.ensure_future(asked.wait())
    # asked first by hand: a worker says only that it waited, not for what
    knock = distributed.core.connect(serving.scheduler, timeout=_KNOCK_S, **security.get_connection_args("worker"))
    comm = await _unless(stopping, knock, serving)
    if comm is None:
        return
    comm.abort()
    worker = distributed.Worker(
        serving.scheduler, security=security, protocol="tls", nthreads=1, resources={serving.site: 1},
        name=f"srprov-{serving.site}", host=serving.host or None, port=serving.port, dashboard_address="127.0.0.1:0",
        memory_limit=0, local_directory=folder, death_timeout=_ANSWER_S,
    )  # fmt: skip
    try:
        if await _unless(stopping, worker, serving) is None:
            return
        ready(worker.address)
        gone = asyncio.ensure_future(worker.finished())
        await asyncio.wait({stopping, gone}, return_when=asyncio.FIRST_COMPLETED)
    finally:
        await _closed(worker)
    if not stopping.done():
        raise _not_served(serving, "the connection ended")


async def _unless(stopping: asyncio.Future[Any], what: Awaitable[Any], serving: Serving) -> Any:  # noqa: ANN401 - Dask's
    """Wait for something, with a deadline; None when a signal asks for the end meanwhile.

    Raises:
        SrprovError: It failed, or took too long.
    """
    begun = asyncio.ensure_future(what)
    await asyncio.wait({begun, stopping}, timeout=_ANSWER_S, return_when=asyncio.FIRST_COMPLETED)
    if begun.done():
        if (error := begun.exception()) is not None:
            raise _not_served(serving, settings.reason(error) or type(error).__name__, error.__cause__)
        return begun.result()
    begun.cancel()
    if stopping.done():
        return None
    raise _not_served(serving, f"no answer within {_ANSWER_S:g} s")


async def _closed(worker: Any) -> None:  # noqa: ANN401 - Dask's
    """Leave the cluster; what was started here ends with its socket when this program does."""
    with contextlib.suppress(Exception):  # the scheduler may be gone
        await asyncio.wait_for(worker.close(timeout=_CLOSE_S), _CLOSE_S)


def _not_served(serving: Serving, why: str, cause: BaseException | None = None) -> SrprovError:
    """Return the error for what Dask says."""
    if "name taken" in why:
        return RefusedError(
            f"a worker of site {serving.site} is connected to {serving.scheduler} already",
            hint="one is enough for a site; end it before another one is started",
            code=Code.SITE,
        )
    if isinstance(cause, socket.gaierror) or (isinstance(cause, OSError) and cause.errno in _OWN_ADDRESS):
        where = f"{serving.host or 'every address'}, port {serving.port}"
        return UsageError(
            f"site {serving.site}: cannot listen at {where}: {why}",
            hint="--host is an address of this machine, --port one that nobody uses",
            code=Code.SITE,
        )
    return SiteLost(
        f"site {serving.site}: the scheduler {serving.scheduler} cannot be reached: {why}",
        hint="is it running, and are its certificates of the same authority? See docs/sites.md",
        code=Code.SITE,
    )
