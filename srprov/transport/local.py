"""The controller itself as a robot (`ansible_connection: local`): a shell over pipes, the engine's socket, psutil.

Takes a `Host`, gives a `Session`. Everything above the pipes is what robots over SSH get too: the same framing, the
same root shell (by sudo for other users), the same engine client.
"""

from __future__ import annotations

import contextlib
import getpass
import os
import secrets
import select
import signal
import socket
import subprocess
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from srprov.definitions.model import Host
from srprov.errors import ConnectError
from srprov.secret import Secret
from srprov.transport.deadline import Deadline
from srprov.transport.frames import start_command
from srprov.transport.session import BaseSession
from srprov.transport.shell import Shell
from srprov.wire import Measures, Traffic

if TYPE_CHECKING:
    from srprov.transport import ConnectOptions, Peers
    from srprov.transport.engine_stream import EngineSocket

_CHUNK = 1 << 16
_BESIDE_S = 20.0
_DEFAULT_SOCKET = "unix:///var/run/docker.sock"


class PipeStreams:
    """The pipes of a local process, for `Shell`."""

    def __init__(self, command: str, traffic: Traffic) -> None:
        """Start `sh -c command` in a process group of its own, so that Ctrl-C at the terminal does not reach it.

        Raises:
            OSError: There is no `sh`.
        """
        self._process = subprocess.Popen(
            ["/bin/sh", "-c", command],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, bufsize=0, start_new_session=True,
        )  # fmt: skip
        self._traffic = traffic
        assert self._process.stdin and self._process.stdout and self._process.stderr
        self._pipes = (self._process.stdin, self._process.stdout, self._process.stderr)
        self._in, self._out, self._err = (pipe.fileno() for pipe in self._pipes)
        self._open = {self._out, self._err}
        self._closed = False
        for descriptor in (self._in, self._out, self._err):
            os.set_blocking(descriptor, False)

    def write(self, data: memoryview) -> int:
        """Send what the pipe takes."""
        try:
            sent = os.write(self._in, data[:_CHUNK])
        except OSError:
            return 0  # full, or closed: `ended` says so in a moment
        self._traffic.bytes_sent += sent
        return sent

    def read(self) -> tuple[bytes, bytes]:
        """Give what is here of both streams."""
        return self._read(self._out), self._read(self._err)

    def _read(self, descriptor: int) -> bytes:
        """Read one pipe until it is empty for now, or a fair share of it."""
        parts: list[bytes] = []
        while descriptor in self._open and len(parts) < 16:
            try:
                piece = os.read(descriptor, _CHUNK)
            except BlockingIOError:
                break
            except OSError:
                piece = b""
            if not piece:
                self._open.discard(descriptor)
                break
            parts.append(piece)
        data = b"".join(parts)
        self._traffic.bytes_received += len(data)
        return data

    def wait(self, seconds: float, *, writing: bool) -> None:
        """Sleep until a pipe can be used."""
        if self._closed:
            return
        poll = select.poll()
        for descriptor in self._open:
            poll.register(descriptor, select.POLLIN)
        if writing:
            poll.register(self._in, select.POLLOUT)
        with contextlib.suppress(OSError):
            poll.poll(1000 * seconds)

    @property
    def ended(self) -> bool:
        """Tell whether both pipes are at their end."""
        return self._closed or not self._open

    def reason(self) -> str:
        """Say how the shell ended."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            return f"the shell ended with status {self._process.wait(timeout=0.2)}"
        return "the shell ended"

    def close(self) -> None:
        """End the shell and what it started."""
        if self._closed:
            return
        self._closed = True
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGTERM)
        with contextlib.suppress(OSError):
            self._pipes[0].close()
        try:
            self._process.wait(timeout=1)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        for pipe in self._pipes[1:]:
            with contextlib.suppress(OSError):
                pipe.close()


class LocalSession(BaseSession):
    """A `Session` with this machine."""

    _streams: PipeStreams

    @classmethod
    def open(cls, host: Host, options: ConnectOptions, peers: Peers | None = None) -> LocalSession:
        """Start the shell.

        Raises:
            AuthError: sudo wants a password.
            ConnectError: The shell cannot be started.
            DeadlineError: It was not ready in time.
        """
        traffic = Traffic(connections=1)
        mark = secrets.token_hex(16)
        streams, shell = _start_shell(host.name, traffic, options.connect_timeout_s, host.become_password, mark)
        session = cls(host.name, shell, traffic, peers, mark)
        session._become = host.become_password
        session._streams = streams
        return session

    @property
    def alive(self) -> bool:
        """Tell whether the shell still runs."""
        return not self._streams.ended

    def measure(self) -> Measures | None:
        """Give load and memory of this machine."""
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

    def _dial_engine(self, seconds: float) -> EngineSocket:
        """Connect to the engine's socket: DOCKER_HOST, or the usual one."""
        from srprov.transport.engine_stream import EngineGone, EngineSocket

        where = os.environ.get("DOCKER_HOST") or _DEFAULT_SOCKET
        parts = urlsplit(where)
        try:
            if parts.scheme == "unix":
                sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
                sock.settimeout(seconds)
                sock.connect(parts.path)
            elif parts.scheme == "tcp" and parts.hostname:
                sock = socket.create_connection((parts.hostname, parts.port or 2375), timeout=seconds)
            else:
                raise EngineGone(f"DOCKER_HOST={where} is not supported here; give unix:// or tcp://")
        except TimeoutError:
            raise
        except FileNotFoundError:
            raise EngineGone(
                f"there is no Docker Engine at {where}: is docker installed, and dockerd running?"
            ) from None
        except PermissionError:
            user = getpass.getuser()
            raise EngineGone(f"user {user!r} may not use {where}: add it to the group docker, or be root") from None
        except EngineGone:
            raise
        except OSError as error:
            raise EngineGone(f"no Docker Engine answers at {where}: {error.strerror}") from None
        return EngineSocket(sock, lambda: "", lambda: bool(select.select([sock], [], [], 0)[0]))

    def _beside(self) -> PipeStreams:
        """Start a second shell over pipes of its own."""
        return _start_shell(self._host, self._traffic, _BESIDE_S, self._become)[0]

    def _close_connection(self) -> None:
        """Nothing is left to close behind the shell."""


def _start_shell(
    host: str, traffic: Traffic, seconds: float, password: Secret | None, mark: str = ""
) -> tuple[PipeStreams, Shell]:
    """Start a root shell over pipes and wait until it is ready; its errors are those of `LocalSession.open`."""
    deadline, nonce = Deadline(seconds), secrets.token_hex(16)
    try:
        command = start_command(nonce, "sh", root=os.geteuid() == 0, mark=mark, ask=password is not None)
        streams = PipeStreams(command, traffic)
    except OSError as error:
        raise ConnectError(host, f"/bin/sh cannot be started: {error.strerror}", hint="is this POSIX?") from None
    shell = Shell(host, streams, traffic, user=getpass.getuser(), password=password)
    shell.wait_ready(nonce, deadline)
    return streams, shell
