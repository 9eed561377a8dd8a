"""A `fabric.Connection` over a connection that is open: for scripts that want more than a session's protocol.

Takes a `StrictConnection`, returns fabric's `run`, `sudo`, `put`, `get` and port forwards on it, without another login
and without fabric's own, which would trust any host key. Imported only when a script asks: fabric takes 50 ms.
"""

from __future__ import annotations

import invoke
import paramiko
import paramiko.config
from fabric import Config, Connection

from srprov.transport.openssh.connection import StrictConnection


class OpenConnection(Connection):  # type: ignore[misc]  # fabric is untyped
    """fabric's connection without its login; the session that lent the connection ends it."""

    _sftp: paramiko.SFTPClient | None

    def __init__(self, lent: StrictConnection) -> None:
        """Take an open connection."""
        paramiko.config.invoke = invoke  # type: ignore[attr-defined]  # as whoever imports both finds it
        settings = lent.settings
        # an empty configuration: the usual one reads ~/.fabric.* and ssh_config again
        config = Config(lazy=True, ssh_config=paramiko.SSHConfig())
        super().__init__(settings.hostname, user=settings.user, port=settings.port, config=config, gateway=False)
        self.client, self.transport = lent.client, lent.transport

    def open(self) -> None:
        """Do nothing while the connection stands.

        Raises:
            paramiko.SSHException: It does not any more.
        """
        if not self.is_connected:
            raise paramiko.SSHException("the session that lent this connection has ended")

    def close(self) -> None:
        """End what was opened here, and leave the connection."""
        if self._sftp is not None:
            self._sftp.close()
            self._sftp = None
