"""Dial before paramiko is imported: an sshd takes longer to greet than a TCP connection takes, the import longer still.

Takes a `Host`; returns a connected socket, or nothing where only ssh_config says where to dial. What is dialled is used
only if the settings, which are worked out later, name the same place.
"""

from __future__ import annotations

import re
import socket
from dataclasses import dataclass
from pathlib import Path

from srprov.definitions.model import Host
from srprov.transport.deadline import Deadline
from srprov.transport.openssh import sockets
from srprov.transport.openssh.settings import SshSettings
from srprov.transport.openssh.ssh_config import config_texts, needs_openssh

_WHERE = r"hostname|port|proxy\w*|addressfamily|bind\w+|canonical\w+|connecttimeout"
_DECIDES = re.compile(rf"^\s*({_WHERE})\b", re.IGNORECASE | re.MULTILINE)


@dataclass(frozen=True, kw_only=True, slots=True)
class Dialled:
    """A socket, and where it leads to."""

    sock: socket.socket
    place: tuple[str, int]
    deadline: Deadline
    """Of the whole connection; it began with the dial."""

    def fitting(self, settings: SshSettings) -> socket.socket | None:
        """Return the socket if it leads where the settings want to; it is closed if not."""
        detour = settings.proxy_command or settings.proxy_jump or settings.address_family != socket.AF_UNSPEC
        if not detour and self.place == (settings.hostname, settings.port):
            return self.sock
        self.sock.close()
        return None


def dial_early(host: Host, seconds: float, ssh_config: Path | None) -> Dialled | None:
    """Connect to where the inventory says that the host is; None where something else may have a say in that.

    Raises:
        ConnectError, DeadlineError: as `sockets.dial`.
    """
    if any(_DECIDES.match(key) for key, _ in host.ssh_options) or _configured(ssh_config):
        return None
    place, deadline = (host.address, host.port or 22), Deadline(seconds)
    return Dialled(sock=sockets.dial(host.name, *place, deadline), place=place, deadline=deadline)


def _configured(ssh_config: Path | None) -> bool:
    """Tell whether a configuration file may lead elsewhere."""
    try:
        texts = config_texts(ssh_config)
    except OSError:
        return True  # whoever reads it properly says what is wrong with it
    return any(needs_openssh(text, file) or _DECIDES.search(text) for file, text in texts.items())
