"""The wire: the only room with sockets. It carries what `wire.py` describes, and decides nothing.

Takes a `Host`, gives a `Session` over one SSH connection (`ssh.py`) or over local pipes (`local.py`). A session has
one shell (`shell.py`, cut apart by `frames.py`) for `Query`, `Run` and `Put`, a stream to the Docker Engine for
`EngineQuery` (`engine_reads.py`), and a client for `EngineCall` and `CopyImage` (`engine.py`). `Sessions` (`pool.py`)
connects to many robots at once; one that fails is a value there.

Importing this package is cheap: paramiko is imported when the first connection is made, the docker SDK when something
changes, fabric when a script asks for it (`scripting.py`).
"""

from __future__ import annotations

import functools
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from srprov.secret import Vault

if TYPE_CHECKING:
    from pathlib import Path

    from srprov.definitions.model import Host
    from srprov.wire import Session

__all__ = ["ConnectOptions", "Peers", "connect"]

Peers = Callable[[str], "Session"]
"""Gives the session of another robot by its name, for `CopyImage`; raises TransportError when there is none."""


@dataclass(frozen=True, kw_only=True, slots=True)
class ConnectOptions:
    """How to connect; the inventory and ssh_config say whom to and as whom."""

    connect_timeout_s: float = 10.0
    """For everything from the name lookup to the ready shell; `ConnectTimeout` of the host's ssh options wins."""
    attempts: int = 3
    """How often a connection that sshd dropped before its banner (MaxStartups) is tried, inside the timeout."""
    ssh_config: Path | None = None
    """Used instead of ~/.ssh/config and /etc/ssh/ssh_config, as `ssh -F` does."""
    warm_engine: bool = True
    """Open the channel to the Docker Engine in the background while the first questions are asked."""
    vault: Vault = field(default_factory=Vault)
    """What the sessions put in the place of the names of secrets."""


def connect(host: Host, *, options: ConnectOptions | None = None, peers: Peers | None = None) -> Session:
    """Open a session with one robot, or with this machine for `ansible_connection: local`.

    Raises:
        ConnectError: Name lookup, TCP, banner, key exchange or the shell failed.
        HostKeyError: The host key is unknown, changed or revoked.
        AuthError: No key or password was accepted, or sudo wants a password.
        DeadlineError: It took longer than `connect_timeout_s`.
    """
    chosen = options or ConnectOptions()
    if host.connection == "local":
        from srprov.transport.local import LocalSession

        local = LocalSession.open(host, chosen, peers)
        local.vault = chosen.vault
        return local
    from srprov.transport.ahead import dial_ahead

    ahead = dial_ahead(host, chosen.connect_timeout_s, chosen.ssh_config)
    try:
        load_ssh()
        from srprov.transport.ssh import SshSession

        session = SshSession.open(host, chosen, peers, ahead)
    except BaseException:
        if ahead:
            ahead.sock.close()
        raise
    session.vault = chosen.vault
    return session


def load_ssh() -> None:
    """Import what connects, once, without invoke: paramiko wants it for `Match exec` alone, which `ssh -G` does here.

    With asyncio, unittest and a YAML parser of its own, invoke takes half as long to import as paramiko itself.
    """
    with _loading:
        if "srprov.transport.ssh" in sys.modules:
            return
        known = "invoke" in sys.modules
        if not known:
            sys.modules["invoke"] = None  # type: ignore[assignment]  # the documented way to make an import fail
        try:
            import srprov.transport.ssh

            del srprov
        finally:
            if not known:
                del sys.modules["invoke"]


@functools.lru_cache(maxsize=1)
def prefetch() -> threading.Thread:
    """Import the docker SDK (0.1 s) in the background, once; only what changes something needs it."""

    def load() -> None:
        import srprov.transport.engine

        del srprov

    thread = threading.Thread(target=load, name="import docker", daemon=True)
    thread.start()
    return thread


_loading = threading.Lock()
