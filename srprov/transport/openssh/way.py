"""The first part of the way to a robot: settings and TCP, for which paramiko is not needed.

So a robot's sshd starts while paramiko is imported here. Takes a `Host`, returns a `Way` for `SshSession.open`.
"""

from __future__ import annotations

import socket
from dataclasses import dataclass

from srprov.definitions.model import Host
from srprov.transport.deadline import Deadline
from srprov.transport.openssh import sockets
from srprov.transport.openssh.resolve import resolve
from srprov.transport.openssh.settings import SshSettings
from srprov.transport.options import ConnectOptions


@dataclass(frozen=True)
class Way:
    """Where a robot is, by when it must have been reached, and how far one has come."""

    settings: SshSettings
    deadline: Deadline
    socket: socket.socket | None = None
    """Connected to its sshd; None where jump hosts or a program lie in between."""


def set_out(host: Host, options: ConnectOptions) -> Way:
    """Find out how to reach a robot, and connect to its sshd where nothing lies in between.

    Raises:
        ConnectError: ssh_config cannot be read or resolved; no such name, refused, unreachable.
        DeadlineError: No answer in time.
    """
    settings = resolve(host, ssh_config=options.ssh_config)
    deadline = Deadline(settings.connect_timeout_s or options.connect_timeout_s)
    if settings.proxy_command or settings.proxy_jump:
        return Way(settings, deadline)
    return Way(settings, deadline, dial(settings, deadline))


def dial(settings: SshSettings, deadline: Deadline) -> socket.socket:
    """Connect to an sshd.

    Raises:
        TransportError: As `sockets.dial`.
    """
    name, family = settings.name, settings.address_family
    return sockets.dial(name, settings.hostname, settings.port, deadline, family)
