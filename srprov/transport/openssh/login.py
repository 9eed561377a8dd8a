"""A login on a robot: its user's own shell, or one command, as `ssh` would give it. No shell of srprov's is started.

Takes a `Host`, gives a `ContainerCommand` on a connection of its own: address, keys, password, jump hosts and host keys
are those of every other connection.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import paramiko

from srprov.codes import Code
from srprov.definitions.model import Host
from srprov.errors import TransportError
from srprov.session import Traffic
from srprov.transport.openssh.channel import ChannelStreams, start
from srprov.transport.openssh.connection import open_connection
from srprov.transport.openssh.way import set_out
from srprov.transport.options import ConnectOptions

_STATUS_S = 10.0
"""For sshd to say how a command ended whose streams have ended."""


class RobotLogin:
    """A shell or command of the robot's user; one thread may read, another may write."""

    def __init__(self, host: Host, options: ConnectOptions, command: str, terminal: str) -> None:
        """Connect, log in and start it.

        Args:
            host: The robot.
            options: How to connect.
            command: For the user's shell; empty: the shell itself.
            terminal: What kind of terminal it gets (TERM); empty: none.

        Raises:
            TransportError: As `srprov.transport.connect`; or sshd gives no terminal, or opens no session.
        """
        way = set_out(host, options)
        self._host = host.name
        self._connection = open_connection(way, Traffic(), options.attempts)
        try:
            self._channel = start(self._connection, command, way.deadline, terminal)
        except BaseException:
            self._connection.close()
            raise

    def output(self) -> Iterator[tuple[int, bytes]]:
        """Yield what it writes as it comes, each with 1 or 2 for its stream, until it ends.

        Raises:
            TransportError: The robot is gone.
        """
        streams = ChannelStreams(self._channel)
        while True:
            out, complaints = streams.read()
            if out:
                yield 1, out
            if complaints:
                yield 2, complaints
            if out or complaints:
                continue
            if streams.ended:
                break
            streams.wait(1.0, writing=False)
        if not self._connection.transport.is_active() and not self._channel.status_event.is_set():
            raise TransportError(
                self._host, "the connection was lost", hint="is the robot up, and its network?", code=Code.LOST
            )

    def write(self, data: bytes) -> None:
        """Send to its standard input; what cannot be sent is dropped, since it has ended then."""
        with contextlib.suppress(OSError, EOFError, paramiko.SSHException):
            self._channel.sendall(data)

    def close_input(self) -> None:
        """Let it see the end of its standard input."""
        with contextlib.suppress(OSError, EOFError, paramiko.SSHException):
            self._channel.shutdown_write()

    def resize(self, rows: int, columns: int) -> None:
        """Tell its terminal the size."""
        with contextlib.suppress(OSError, EOFError, paramiko.SSHException):
            self._channel.resize_pty(width=columns, height=rows)

    def exit_code(self) -> int | None:
        """Return its code, once its output has ended; None when a signal ended it.

        Raises:
            TransportError: sshd does not say.
        """
        if not self._channel.status_event.wait(_STATUS_S):
            raise TransportError(
                self._host, "how the command ended is not known", hint="its output is whole", code=Code.LOST
            )
        code = self._channel.exit_status
        return code if 0 <= code <= 255 else None

    def close(self) -> None:
        """End the login."""
        with contextlib.suppress(OSError, EOFError, paramiko.SSHException):
            self._channel.close()
        self._connection.close()
