"""Ports of the robot's loopback whose connections come here, over the SSH connection that is open anyway.

Takes a paramiko transport and a function that answers one connection; gives the port that sshd listens on. Nothing
listens on this machine: a connection to the port is a channel, and each channel has a thread.
Source: RFC 4254, section 7.1; OpenSSH's sshd_config(5), AllowTcpForwarding, PermitListen.
"""

from __future__ import annotations

import contextlib
import queue
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import TimeoutError as NotYet

import paramiko

from srprov.transport.background import background

_LOOPBACK = "127.0.0.1"
_OURS = (_LOOPBACK, "::ffff:127.0.0.1")
"""Where connections may come from; sshd with `GatewayPorts yes` listens on every address, whatever is asked."""
_CANCEL_S = 5.0
_MOST_CHANNELS = 16
"""At once; a pull has three to six. Any user of the robot may connect."""
_MOST_WAITING = 64

Answer = Callable[[paramiko.Channel], None]


class ForwardRefused(Exception):
    """sshd forwards no port; the text says why."""


class ReverseForwards:
    """The ports of one connection."""

    def __init__(self, transport: paramiko.Transport) -> None:
        """Take the connection."""
        self._transport = transport
        self._doors: dict[int, _Door] = {}
        self._asking = threading.Lock()

    @contextlib.contextmanager
    def open(self, answer: Answer, seconds: float) -> Iterator[int]:
        """Let sshd listen on a port of its choice, for as long as the context is open.

        Args:
            answer: Answers one connection, in a thread of its own; the channel is closed when it returns.
            seconds: How long sshd may take to answer.

        Raises:
            ForwardRefused: sshd forbids it, or does not answer.
        """
        port = self._listen(seconds)
        door = self._doors[port] = _Door(answer)
        try:
            yield port
        finally:
            del self._doors[port]
            door.close()
            self._cancel(port)

    def _listen(self, seconds: float) -> int:
        # paramiko's request has no deadline, and may be woken by a new key exchange: with no answer it is a refusal
        def ask() -> int:
            with self._asking:
                self._transport.global_response = None
                return self._transport.request_port_forward(_LOOPBACK, 0, self._arrived)

        try:
            port = background(ask).result(seconds)
        except NotYet:
            raise ForwardRefused(f"sshd did not answer within {seconds:g} s") from None
        except (paramiko.SSHException, OSError, EOFError) as error:
            why = "AllowTcpForwarding or PermitListen forbids it" if self._transport.is_active() else str(error)
            raise ForwardRefused(f"sshd forwards no port: {why}") from error
        if not 0 < port < 1 << 16 or port in self._doors:
            raise ForwardRefused(f"sshd says that it listens on port {port}")
        return port

    def _cancel(self, port: int) -> None:
        """Let sshd close its port; one that does not keeps a port behind which nobody is, until the session ends.

        Not by `cancel_port_forward`: it takes the handler away, which a channel on its way then calls.
        """

        def ask() -> None:
            with self._asking, contextlib.suppress(paramiko.SSHException, OSError, EOFError):
                self._transport.global_request("cancel-tcpip-forward", (_LOOPBACK, port), wait=True)

        with contextlib.suppress(NotYet):
            background(ask).result(_CANCEL_S)

    def _arrived(self, channel: paramiko.Channel, origin: tuple[str, int], server: tuple[str, int]) -> None:
        """Hand a new channel on. This is paramiko's own thread, which must not wait: nothing else moves meanwhile.

        A channel that nobody takes is closed by being forgotten.
        """
        door = self._doors.get(server[1])
        if door is not None and origin[0] in _OURS:
            door.arrived(channel)


class _Door:
    """What happens to the connections to one port."""

    def __init__(self, answer: Answer) -> None:
        self._answer = answer
        self._waiting: queue.Queue[paramiko.Channel | None] = queue.Queue(_MOST_WAITING)
        self._room = threading.BoundedSemaphore(_MOST_CHANNELS)
        self._open: set[paramiko.Channel] = set()
        self._closed = threading.Event()
        threading.Thread(target=self._hand_out, name="forward", daemon=True).start()

    def arrived(self, channel: paramiko.Channel) -> None:
        """Take a channel, unless too many wait."""
        with contextlib.suppress(queue.Full):
            self._waiting.put_nowait(channel)

    def _hand_out(self) -> None:
        """Give each channel a thread; beyond sixteen they are closed."""
        while not self._closed.is_set():
            channel = self._waiting.get()
            if channel is None or self._closed.is_set() or not self._room.acquire(blocking=False):
                _close(channel)
                continue
            self._open.add(channel)
            threading.Thread(target=self._serve, args=(channel,), name="forwarded", daemon=True).start()

    def _serve(self, channel: paramiko.Channel) -> None:
        try:
            if not self._closed.is_set():  # seen here, or `close` sees the channel
                self._answer(channel)
        finally:
            _close(channel)
            self._open.discard(channel)
            self._room.release()

    def close(self) -> None:
        """End all connections, and take no more."""
        self._closed.set()
        with contextlib.suppress(queue.Full):
            self._waiting.put_nowait(None)  # a full queue wakes the thread as well
        for channel in list(self._open):
            _close(channel)


def _close(channel: paramiko.Channel | None) -> None:
    if channel is not None:
        with contextlib.suppress(OSError, EOFError, paramiko.SSHException):
            channel.close()
