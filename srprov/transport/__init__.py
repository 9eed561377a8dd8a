"""The wire: the only room with sockets. It carries what `wire.py` describes, and decides nothing.

`connect` takes a `Host` and returns a `Session` over one SSH connection (`ssh_session.py`) or over local pipes
(`local_session.py`); `Sessions` (`pool.py`) connects to many robots at once, and one that fails is a value there.

A session has one shell (`shell/`) for `Query`, `Run` and `Put`, a stream to the Docker Engine for `EngineQuery` and a
client for `EngineCall` and `CopyImage` (`engine/`); the SSH connection itself is `openssh/`.

Importing this package is cheap: paramiko is imported when the first connection is made, the docker SDK when something
changes, fabric when a script asks for it (`openssh/scripting.py`).
"""

from __future__ import annotations

import sys
import threading
from typing import TYPE_CHECKING

from srprov.errors import ConnectError
from srprov.transport.options import ConnectOptions, Peers

if TYPE_CHECKING:
    from srprov.definitions.model import Host
    from srprov.session import ContainerCommand, Session

__all__ = ["ConnectOptions", "Peers", "connect", "log_in", "on_record", "preload_ssh"]

_loading = threading.Lock()


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
        from srprov.transport.local_session import LocalSession

        return LocalSession.open(host, chosen, peers)
    from srprov.transport.openssh.way import set_out

    way = set_out(host, chosen)
    preload_ssh()
    from srprov.transport.ssh_session import SshSession

    return SshSession.open(host, way, chosen, peers)


def log_in(host: Host, command: str, terminal: str, *, options: ConnectOptions) -> ContainerCommand:
    """Log in at one robot over SSH, for its user's shell or one command; see `openssh/login.py`.

    Raises:
        TransportError: As `connect`.
    """
    preload_ssh()
    from srprov.transport.openssh.login import RobotLogin

    return RobotLogin(host, options, command, terminal)


def on_record(host: Host) -> frozenset[str]:
    """Return what the `identity` of a robot can be, by the host keys that are on record for it here; ask nobody."""
    if host.connection == "local":
        return frozenset({f"{host.name} local"})
    from srprov.transport.openssh.host_keys import keys_of
    from srprov.transport.openssh.resolve import resolve

    try:
        keys = keys_of(resolve(host))
    except ConnectError:  # by such settings nobody is connected to, so nobody has proved anything
        return frozenset()
    revoked = {one.blob for one in keys if one.marker == "@revoked"}
    return frozenset(f"{host.name} {one.fingerprint}" for one in keys if not one.marker and one.blob not in revoked)


def preload_ssh() -> None:
    """Import what connects, once, without invoke: paramiko wants it for `Match exec` alone, which `ssh -G` does here.

    With asyncio, unittest and a YAML parser of its own, invoke takes half as long to import as paramiko itself.
    """
    with _loading:
        if "srprov.transport.ssh_session" in sys.modules:
            return
        known = "invoke" in sys.modules
        if not known:
            sys.modules["invoke"] = None  # type: ignore[assignment]  # the documented way to make an import fail
        try:
            import srprov.transport.ssh_session

            del srprov
        finally:
            if not known:
                del sys.modules["invoke"]
