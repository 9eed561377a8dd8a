"""The robots of an inventory and the sessions with them.

Takes an Inventory; gives a `Fleet`, which connects in the background and is asked through `Gathering`. Connections end
with the block.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING

import msgspec

from srprov.secret import Vault

if TYPE_CHECKING:
    from srprov.definitions.model import Experiment, Inventory
    from srprov.facts.gather import Detail, Gathering
    from srprov.facts.model import Snapshot
    from srprov.session import Session
    from srprov.transport.pool import Sessions


_MANY = 200
"""Robots, from which on threads wait for each other for longer, and wake less often."""


class Sharing(msgspec.Struct, frozen=True, kw_only=True):
    """How connections are shared among processes of this machine."""

    workers: str = "1"
    """How many processes have them, or `auto`; 1: this one."""
    rate_per_s: float = 40.0
    """How many connections are begun per second, by all of them together."""
    scheduler: str = ""
    """Address of the cluster that reaches robots at sites; empty: they are reached from here."""


ALONE = Sharing()


class Fleet(msgspec.Struct, frozen=True):
    """An inventory with open sessions."""

    inventory: Inventory
    sessions: Sessions
    forks: int

    def connected(self) -> Mapping[str, Session]:
        """Return the sessions of robots that could be reached."""
        return self.sessions.connected()

    def awaited(self) -> list[str]:
        """Return the robots that a connection is still being made to."""
        return self.sessions.awaited()

    def look(
        self, experiment: Experiment, *, exact: bool = False, meanwhile: Callable[[], None] | None = None
    ) -> Gathering:
        """Begin to ask every robot, as soon as it is connected, for an experiment that may run there.

        The engines are asked of themselves at once with `exact`, and when a service requires a disk of some size: which
        one is Docker's, only the engine knows for sure. `meanwhile` is called when something is to be decided, while
        the robots are asked once more.
        """
        from srprov.facts.gather import Gathering

        engine = exact or any(service.requires.disk for service in experiment.services.values())
        ports = any(service.runtime.ports or service.runtime.expose for service in experiment.services.values())
        ports = ports or experiment.network.encryption != "none"
        return Gathering(
            self.inventory, self.sessions.get, engine=engine, ports=ports, forks=self.forks, meanwhile=meanwhile
        )

    def gather(self, detail: Detail, *, keep_mute: bool = False) -> Snapshot:
        """Ask every robot once and return what was found; see `srprov.facts.gather.gather`."""
        from srprov.facts.gather import gather

        return gather(self.inventory, self.sessions.get, detail=detail, forks=self.forks, keep_mute=keep_mute)


def checked_scheduler(address: str) -> str:
    """Return the address of a cluster's scheduler.

    Raises:
        RefusedError: It is one without TLS.
        UsageError: It is no address.
    """
    from srprov.transport.sites.settings import checked_address

    return checked_address(address)


@contextmanager
def connect(
    inventory: Inventory, *, timeout_s: float, forks: int, changing: bool = False, vault: Vault | None = None,
    sharing: Sharing = ALONE,
) -> Iterator[Fleet]:  # fmt: skip
    """Begin to connect to all robots; connections end with the block.

    Args:
        inventory: The robots.
        timeout_s: To connect to one of them.
        forks: Robots at the same time.
        changing: A run will follow, so begin to import what records it.
        vault: The secrets that are written there.
        sharing: Which processes have the connections, and how fast they are begun.
    """
    from srprov.transport import ConnectOptions, preload_ssh
    from srprov.transport.pool import Sessions

    options = ConnectOptions(connect_timeout_s=timeout_s, vault=vault or Vault())
    workers = 1
    if len(inventory.hosts) >= _MANY:
        from srprov.transport.workers.counting import CROWDED_S

        sys.setswitchinterval(CROWDED_S)
    if sharing.workers != ALONE.workers:
        from srprov.transport.workers.counting import wanted_workers

        workers = wanted_workers(sharing.workers, len(inventory.hosts))
    pool = Sessions(
        inventory.hosts, options=options, forks=forks, rate_per_s=sharing.rate_per_s, workers=workers,
        scheduler=sharing.scheduler,
    )  # fmt: skip
    with pool as sessions:
        here = (host for host in inventory.hosts.values() if not (sharing.scheduler and host.site))
        if workers == 1 and any(host.connection != "local" for host in here):
            preload_ssh()  # before anything else is imported: from then on the robots have something to do too
        if changing:
            threading.Thread(target=_import_record, name="import record", daemon=True).start()
        yield Fleet(inventory, sessions, forks)


def _import_record() -> None:
    """Import what records a run, while connections come up."""
    from srprov.record.documents import this_machine

    this_machine()
