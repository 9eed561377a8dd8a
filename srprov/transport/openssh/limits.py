"""What an sshd may send: a banner of some length, messages of some size, and on a channel no more than it was allowed.

Takes and gives what paramiko's own classes do; they believe a peer. A packet may claim 4 GiB, a line before the banner
need not end, and data beyond a channel's window is kept in memory. Text that is none ends their reader with any error.
Source: RFC 4253, 4.2 and 6.1; RFC 4254, 5.2; OpenSSH's packet.h (PACKET_MAX_SIZE).
"""

from __future__ import annotations

from typing import Any

import paramiko
from paramiko.packet import Packetizer

GREETING = 64 * 1024
"""Bytes up to the end of the banner's line."""
PACKET = 256 * 1024
"""OpenSSH's own limit."""


class Flooded(paramiko.SSHException):
    """The far end sent more than it may."""


class Unreadable(paramiko.SSHException):
    """The far end sent a message that is none."""


def in_words(error: Exception | None) -> Exception | None:
    """Return what ended paramiko's reader, which may be any error, as one of those that its callers expect."""
    if error is None or isinstance(error, (paramiko.SSHException, OSError, EOFError)):
        return error
    return Unreadable(f"a message of its sshd cannot be read ({type(error).__name__})")


class BoundedPacketizer(Packetizer):
    """Reads what an SSH server may send, and no more."""

    def __init__(self, socket: Any) -> None:  # noqa: ANN401 - as paramiko has it
        """Take the connection."""
        self._greeted = 0
        super().__init__(socket)

    def read_all(self, n: int, check_rekey: bool = False) -> bytes:
        """Read `n` bytes.

        Raises:
            Flooded: No packet is that long.
        """
        if n > PACKET + 1024:
            raise Flooded(f"it announced a packet of {n} bytes; the longest has {PACKET >> 10} KiB")
        data: bytes = super().read_all(n, check_rekey)
        return data

    def _read_timeout(self, timeout: float) -> bytes:
        """Read a piece of the lines up to the banner."""
        piece: bytes = super()._read_timeout(timeout)  # type: ignore[misc]  # its stubs leave it out
        self._greeted += len(piece)
        if self._greeted > GREETING:
            raise Flooded(f"it sent more than {GREETING >> 10} KiB before its SSH banner")
        return piece


def feed(channel: Any, message: Any) -> None:  # noqa: ANN401 - paramiko's Channel and Message
    """Take data of a channel."""
    channel._feed(message)
    _check_window(channel)


def feed_extended(channel: Any, message: Any) -> None:  # noqa: ANN401 - paramiko's Channel and Message
    """Take data of a channel's standard error."""
    channel._feed_extended(message)
    _check_window(channel)


def _check_window(channel: Any) -> None:  # noqa: ANN401 - paramiko's Channel
    """Refuse (Flooded) what is beyond the window: data that nobody has read yet fits into it."""
    unread = len(channel.in_buffer) + len(channel.in_stderr_buffer)
    if unread > channel.in_window_size + PACKET:
        raise Flooded(f"it sent {unread >> 10} KiB on a channel whose window is {channel.in_window_size >> 10} KiB")
