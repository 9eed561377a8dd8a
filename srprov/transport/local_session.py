"""The controller itself as a robot (`ansible_connection: local`): a shell over pipes, the engine's socket, psutil.

Takes a `Host`, returns a `Session`. Everything above the pipes is what robots over SSH get too: the same framing, the
same root shell (by sudo for other users), the same engine client.
"""

from __future__ import annotations

import getpass
import os
import secrets
import select
import socket
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from srprov.codes import Code
from srprov.definitions.model import Host
from srprov.errors import ConnectError
from srprov.session import Measures, Traffic
from srprov.transport.deadline import Deadline
from srprov.transport.engine.link import EngineGone, EngineSocket
from srprov.transport.session import BaseSession
from srprov.transport.shell.frames import start_command
from srprov.transport.shell.pipes import PipeStreams
from srprov.transport.shell.shell import Shell
from srprov.transport.shell.startup import wait_ready

if TYPE_CHECKING:
    from srprov.transport.options import ConnectOptions, Peers

_SECOND_SHELL_S = 20.0
_DEFAULT_SOCKET = "unix:///var/run/docker.sock"


class LocalSession(BaseSession):
    """A `Session` with this machine."""

    def __init__(
        self,
        host: Host,
        options: ConnectOptions,
        peers: Peers | None,
        streams: PipeStreams,
        traffic: Traffic,
        mark: str,
    ) -> None:
        """Take what `open` made."""
        super().__init__(host, options, peers, Shell(host.name, streams, traffic), mark)
        self._streams = streams

    @classmethod
    def open(cls, host: Host, options: ConnectOptions, peers: Peers | None = None) -> LocalSession:
        """Start the shell.

        Raises:
            AuthError: sudo wants a password.
            ConnectError: The shell cannot be started.
            DeadlineError: It was not ready in time.
        """
        traffic, mark = Traffic(connections=1), secrets.token_hex(16)
        streams = _start_shell(host, traffic, options.connect_timeout_s, mark)
        return cls(host, options, peers, streams, traffic, mark)

    @property
    def alive(self) -> bool:
        """Tell whether the shell still runs."""
        return not self._streams.ended

    def measure(self) -> Measures | None:
        """Return load and memory of this machine."""
        import psutil

        memory, swap = psutil.virtual_memory(), psutil.swap_memory()
        return Measures(
            cpus=psutil.cpu_count() or 1,
            load1=psutil.getloadavg()[0],
            memory_total=memory.total,
            memory_available=memory.available,
            swap_total=swap.total,
            swap_free=swap.free,
            link_speed_mbit={name: float(link.speed) for name, link in sorted(psutil.net_if_stats().items())},
        )

    def _dial_reads(self, seconds: float) -> EngineSocket:
        """Connect to the engine's socket: DOCKER_HOST, or the usual one."""
        where = os.environ.get("DOCKER_HOST") or _DEFAULT_SOCKET
        try:
            sock = _connect(where, seconds)
        except TimeoutError:
            raise
        except FileNotFoundError:
            why = f"there is no Docker Engine at {where}: is docker installed, and dockerd running?"
            raise EngineGone(why) from None
        except PermissionError:
            user = getpass.getuser()
            raise EngineGone(f"user {user!r} may not use {where}: add it to the group docker, or be root") from None
        except OSError as error:
            raise EngineGone(f"no Docker Engine answers at {where}: {error.strerror}") from None
        if sock is None:
            raise EngineGone(f"DOCKER_HOST={where} is not supported here; give unix:// or tcp://")
        return EngineSocket(sock, lambda: "", lambda: bool(select.select([sock], [], [], 0)[0]))

    _dial_changes = _dial_reads

    def _second_shell(self) -> PipeStreams:
        """Start a second shell over pipes of its own."""
        return _start_shell(self._robot, self.traffic, _SECOND_SHELL_S)

    def _close_connection(self) -> None:
        """Nothing is left to close behind the shell."""


def _connect(where: str, seconds: float) -> socket.socket | None:
    """Connect to an address as DOCKER_HOST has it; None for a kind that is not supported."""
    parts = urlsplit(where)
    if parts.scheme == "tcp" and parts.hostname:
        return socket.create_connection((parts.hostname, parts.port or 2375), timeout=seconds)
    if parts.scheme != "unix":
        return None
    sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        sock.settimeout(seconds)
        sock.connect(parts.path)
    except OSError:
        sock.close()
        raise
    return sock


def _start_shell(host: Host, traffic: Traffic, seconds: float, mark: str = "") -> PipeStreams:
    """Start a root shell over pipes and wait until it is ready; its errors are those of `LocalSession.open`."""
    deadline, nonce, root = Deadline(seconds), secrets.token_hex(16), os.geteuid() == 0
    password = None if root else host.become_password
    command = start_command(nonce, "sh", root=root, mark=mark, ask=password is not None)
    try:
        streams = PipeStreams(command, traffic)
    except OSError as error:
        raise ConnectError(
            host.name, f"/bin/sh cannot be started: {error.strerror}", hint="is this POSIX?", code=Code.SHELL
        ) from None
    wait_ready(host.name, streams, nonce, deadline, user=getpass.getuser(), password=password)
    return streams
