"""The way to a robot's sshd: name lookup, TCP and ProxyCommand, each with a deadline, and every byte counted.

Takes a host name and port, returns a socket for paramiko; errors are in words.
"""

from __future__ import annotations

import contextlib
import errno
import io
import ipaddress
import socket
import subprocess
import tempfile
import threading
from typing import IO, Any

from srprov.codes import Code
from srprov.errors import ConnectError, DeadlineError
from srprov.session import Traffic
from srprov.transport.deadline import Deadline

KEEPALIVE_S = 5
_DEAD_AFTER_MS = 20_000
_WAKE_S = 1.0
_PIECE = 65_536
_NOTHING = memoryview(b"")

_WORDS = {
    errno.ECONNREFUSED: ("connection refused", "does sshd run on the robot, on this port?"),
    errno.EHOSTUNREACH: ("no route to the host", "is the robot switched on and in this network?"),
    errno.ENETUNREACH: ("its network is unreachable", "is this machine in the robot's network (Wi-Fi, VPN)?"),
    errno.ETIMEDOUT: ("no answer", "is the robot switched on? does a firewall drop the port?"),
    errno.ECONNRESET: ("connection reset", "does sshd run on the robot, on this port?"),
    errno.EACCES: ("connecting is not permitted here", "a local firewall refuses it"),
    errno.EPERM: ("connecting is not permitted here", "a local firewall refuses it"),
}


class CountedSocket:
    """What paramiko needs of a socket, with its bytes counted and a `close` that wakes the reading thread at once."""

    def __init__(self, inner: Any, traffic: Traffic) -> None:  # noqa: ANN401 - a socket or a paramiko channel
        """Wrap a connected socket, or a channel of a jump host."""
        self._inner = inner
        self._traffic = traffic
        self._ahead = _NOTHING
        self.getpeername = inner.getpeername
        self._closed = False  # paramiko looks at this name of a real socket while it waits for its thread to end

    def send(self, data: bytes) -> int:
        """Send some of the data."""
        sent: int = self._inner.send(data)
        self._traffic.bytes_sent += sent
        return sent

    def settimeout(self, seconds: float | None) -> None:
        """Set the timeout, but wake seldom: paramiko wants 0.1 s, to see that it was closed, and `close` tells it."""
        self._inner.settimeout(max(seconds, _WAKE_S) if seconds else seconds)

    def recv(self, size: int) -> bytes:
        """Receive up to `size` bytes; none at the end.

        paramiko asks twice for every packet, and a shell's answer is dozens of small ones; what has come is taken at
        once, and waits here.
        """
        if not self._ahead:
            self._ahead = memoryview(self._inner.recv(max(size, _PIECE)))
            self._traffic.bytes_received += len(self._ahead)
        data, self._ahead = bytes(self._ahead[:size]), self._ahead[size:] or _NOTHING  # an empty view keeps all of it
        return data

    def close(self) -> None:
        """Close; without the shutdown a thread inside recv() sleeps on until its timeout."""
        self._closed = True
        if isinstance(self._inner, socket.socket):
            with contextlib.suppress(OSError):
                self._inner.shutdown(socket.SHUT_RDWR)
        self._inner.close()


def dial(host: str, name: str, port: int, deadline: Deadline, family: int = socket.AF_UNSPEC) -> socket.socket:
    """Connect to the first address of a name that answers.

    Args:
        host: The robot's name, for errors.
        name: Name or address to connect to.
        port: TCP port.
        deadline: For the lookup and all addresses together; each address gets a fair share of what is left.
        family: AF_UNSPEC, AF_INET or AF_INET6.

    Raises:
        ConnectError: No such name, refused, unreachable.
        DeadlineError: No answer in time.
    """
    addresses = _lookup(host, name, port, deadline, family)
    failure: OSError | None = None
    for tried, (kind, address) in enumerate(addresses):
        if deadline.passed:
            break
        sock = socket.socket(kind, socket.SOCK_STREAM)
        try:
            sock.settimeout(deadline.left(0.01) / (len(addresses) - tried))
            sock.connect(address)
        except OSError as error:
            sock.close()
            failure = error
            continue
        _tune(sock)
        return sock
    where = f"{name} port {port}"
    if failure is None or isinstance(failure, TimeoutError):
        hint = "is the robot switched on, and in this network? does a firewall drop the port?"
        raise DeadlineError(host, f"no answer from {where} within {deadline.seconds:g} s", hint=hint)
    words, hint = _WORDS.get(
        failure.errno or 0, (failure.strerror or str(failure), "check the robot's address and port")
    )
    raise ConnectError(host, f"{where}: {words}", hint=hint)


def _lookup(host: str, name: str, port: int, deadline: Deadline, family: int) -> list[tuple[int, Any]]:
    """Look a name up in a thread of its own: getaddrinfo has no timeout, and a broken resolver takes 30 s and more."""
    with contextlib.suppress(ValueError):
        literal = ipaddress.ip_address(name)
        return [(socket.AF_INET if literal.version == 4 else socket.AF_INET6, (name, port))]
    answer: list[Any] = []

    def ask() -> None:
        try:
            answer.append(socket.getaddrinfo(name, port, family, socket.SOCK_STREAM))
        except (OSError, UnicodeError) as error:
            answer.append(error)

    thread = threading.Thread(target=ask, name=f"lookup {name}", daemon=True)
    thread.start()
    thread.join(deadline.left())
    if not answer:
        hint = "is the name server reachable? give the robot's address as ansible_host"
        raise DeadlineError(
            host, f"looking up {name!r} took longer than {deadline.seconds:g} s", hint=hint, code=Code.LOOKUP
        )
    if isinstance(answer[0], Exception):
        words = getattr(answer[0], "strerror", None) or str(answer[0])
        hint = "correct the name, or give the robot's address as ansible_host"
        raise ConnectError(host, f"the name {name!r} cannot be looked up: {words}", hint=hint, code=Code.LOOKUP)
    return list(dict.fromkeys((info[0], info[4]) for info in answer[0]))


def _tune(sock: socket.socket) -> None:
    """Make small packets leave at once, and a robot that lost its power be noticed.

    paramiko sets no TCP_NODELAY: a request on an open connection then costs 44 ms instead of 3. Its keepalive only
    sends, and never looks for an answer; TCP_USER_TIMEOUT ends a connection whose packets nobody acknowledges.
    """
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    if hasattr(socket, "TCP_USER_TIMEOUT"):
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _DEAD_AFTER_MS)


class ProxyProcess:
    """A running ProxyCommand behind a real socket.

    paramiko's own ProxyCommand starts no shell (`exec`, `|` and quotes fail) and reads pipes with a busy select.
    """

    def __init__(self, host: str, command: str) -> None:
        """Start the command with the user's `sh`, as OpenSSH does.

        Raises:
            ConnectError: It cannot be started.
        """
        self.socket, theirs = socket.socketpair()
        self._complaints: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - lives as long as the process
        try:
            self._process = subprocess.Popen(
                ["/bin/sh", "-c", f"exec {command}"],
                stdin=theirs.fileno(), stdout=theirs.fileno(), stderr=self._complaints, start_new_session=True,
                cwd="/",  # the folder at hand may be a stranger's: no name in it means anything to the command
            )  # fmt: skip
        except OSError as error:
            self.socket.close()
            raise ConnectError(
                host,
                f"its ProxyCommand cannot be started: {error.strerror}",
                hint="check /bin/sh",
                code=Code.SSH_CONFIG,
            ) from None
        finally:
            theirs.close()

    def complaints(self) -> str:
        """Return the last of what the command wrote to its standard error."""
        end = self._complaints.seek(0, io.SEEK_END)
        self._complaints.seek(max(0, end - _PIECE))
        return " ".join(self._complaints.read(_PIECE).decode("utf-8", "replace").split())[-200:]

    def close(self) -> None:
        """End the process and wait for it."""
        self.socket.close()
        if self._process.poll() is None:
            self._process.terminate()
        try:
            self._process.wait(timeout=2)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._complaints.close()
