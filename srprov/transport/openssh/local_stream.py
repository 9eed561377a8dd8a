"""A channel to a Unix socket of the robot that sshd itself opens: `direct-streamlocal@openssh.com`.

Gives a paramiko transport that can ask for one. paramiko opens channels of any kind, but adds the further fields of
its own kinds only.
Source: OpenSSH's PROTOCOL, section 2.4.
"""

from __future__ import annotations

import threading
from typing import Any, ClassVar

import paramiko
from paramiko.common import MSG_CHANNEL_DATA, MSG_CHANNEL_EXTENDED_DATA
from paramiko.transport import Transport

from srprov.transport.openssh.limits import BoundedPacketizer, feed, feed_extended, in_words

_KIND = "direct-streamlocal@openssh.com"


class LocalStreamTransport(Transport):
    """A transport with `open_local_stream`, and with limits for what the far end sends."""

    _channel_handler_table: ClassVar[dict[int, Any]] = {
        **Transport._channel_handler_table,  # type: ignore[attr-defined]  # paramiko's own, which its stubs leave out
        MSG_CHANNEL_DATA: feed,
        MSG_CHANNEL_EXTENDED_DATA: feed_extended,
    }

    def __init__(self, *args: Any, **options: Any) -> None:  # noqa: ANN401 - as paramiko has it
        """Take what paramiko's transport takes."""
        self._wanted = threading.local()
        super().__init__(*args, **{**options, "packetizer_class": BoundedPacketizer})

    def open_local_stream(self, path: str, seconds: float) -> paramiko.Channel | None:
        """Return a channel to the socket at `path`, or None when sshd does not open it (it says no more than that).

        Raises:
            paramiko.SSHException, EOFError, OSError: The connection was lost.
        """
        self._wanted.path = path
        try:
            return self.open_channel(_KIND, timeout=seconds)
        except paramiko.SSHException:
            # paramiko keeps one reason for all threads: a refusal may come as "unable to open channel", with none
            if not self.is_active():
                raise
            return None
        finally:
            self._wanted.path = None

    def _verify_key(self, host_key: bytes, signature: bytes) -> None:
        """Take the far end's key; when keys are exchanged anew, no other one, as nobody would compare that.

        Raises:
            paramiko.SSHException: It is another one, or did not sign.
        """
        before: paramiko.PKey | None = self.host_key
        super()._verify_key(host_key, signature)  # type: ignore[misc]  # paramiko's own, which its stubs leave out
        if before is not None and self.host_key != before:
            self.host_key = before
            raise paramiko.SSHException("it shows another host key within one connection")

    def get_exception(self) -> Exception | None:
        """Return what ended the connection, once, and nothing but paramiko's own errors and the system's."""
        return in_words(super().get_exception())

    def _send_user_message(self, data: Any) -> None:  # noqa: ANN401 - a paramiko Message
        """Send a message; the first one that `open_channel` sends in this thread gets the fields of its kind."""
        if path := getattr(self._wanted, "path", None):
            self._wanted.path = None
            data.add_string(path)
            data.add_string("")  # reserved
            data.add_int(0)  # reserved
        super()._send_user_message(data)  # type: ignore[misc]  # paramiko's own, which its stubs leave out
