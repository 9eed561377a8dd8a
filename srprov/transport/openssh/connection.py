"""One SSH connection: a paramiko client with strict host keys, deadlines everywhere, and jump hosts.

Takes `SshSettings`, returns an open paramiko transport or one of the transport errors in words: paramiko gets a policy,
a login and a socket of ours. `fabric.Connection` is not what connects: its `open()` trusts any host key (it hard-codes
AutoAddPolicy) and guesses keys, and its import takes longer than the connection. `scripting.py` has one for scripts.
"""

from __future__ import annotations

import functools
import logging
import random
import re
import socket
import time
from typing import Any, cast

import paramiko

from srprov.codes import Code
from srprov.definitions.model import Host
from srprov.errors import ConnectError, DeadlineError, TransportError
from srprov.session import Traffic
from srprov.transport.deadline import Deadline
from srprov.transport.openssh import host_keys, revoked, sockets
from srprov.transport.openssh.algorithms import transport_for
from srprov.transport.openssh.auth import Login
from srprov.transport.openssh.limits import Flooded
from srprov.transport.openssh.local_stream import LocalStreamTransport
from srprov.transport.openssh.resolve import resolve
from srprov.transport.openssh.reverse import ReverseForwards
from srprov.transport.openssh.settings import SshSettings
from srprov.transport.openssh.way import Way, dial

_log = logging.getLogger("paramiko")
_log.addHandler(logging.NullHandler())
# Without this a lost robot prints paramiko's traceback on stderr: its threads log what we raise as an error in words.
_log.propagate = False
_MOST_HOPS = 8
"""Of jump hosts of jump hosts: `ProxyJump gate-%h` for all hosts gives each another one."""


class _Policy(paramiko.MissingHostKeyPolicy):
    """Check each host key against known_hosts. paramiko asks only the policy, as its own key tables stay empty."""

    def __init__(self, settings: SshSettings, known: list[host_keys.KnownKey]) -> None:
        """Take what is on record for the host."""
        self._settings = settings
        self._known = known

    def missing_host_key(self, _client: Any, _hostname: str, key: Any) -> None:  # noqa: ANN401 - paramiko's signature
        """Accept the key or raise HostKeyError."""
        if self._settings.revoked_host_keys:
            revoked.check(self._settings.name, self._settings.revoked_host_keys, key.get_name(), key.asbytes())
        host_keys.check(self._settings, self._known, key.get_name(), key.asbytes())


class StrictConnection:
    """A connection that knows its robot; `open()` raises transport errors, `close()` ends jump hosts too."""

    def __init__(
        self,
        settings: SshSettings,
        deadline: Deadline,
        traffic: Traffic,
        trail: tuple[str, ...] = (),
        dialled: socket.socket | None = None,
    ) -> None:
        """Take where to connect to and by when, which jump hosts lie behind it, and the socket if there is one."""
        self.settings, self.deadline, self.traffic = settings, deadline, traffic
        self.trail, self._dialled = trail, dialled
        self.client = paramiko.SSHClient()
        self.jump: StrictConnection | None = None
        self.proxy: sockets.ProxyProcess | None = None
        self.wire: sockets.CountedSocket | None = None
        self.transport: LocalStreamTransport
        """What channels are opened on, once `open()` is through."""
        self.forwards: ReverseForwards
        """Ports of the robot whose connections come here, once `open()` is through."""

    def open(self) -> None:
        """Connect, check the host key and log in.

        Raises:
            ConnectError: Name, TCP, proxy, banner or key exchange.
            HostKeyError: Unknown, changed or revoked key.
            AuthError: The login was refused.
            DeadlineError: It took too long.
        """
        known = host_keys.keys_of(self.settings)
        self.client.set_missing_host_key_policy(_Policy(self.settings, known))
        try:
            self.wire = sockets.CountedSocket(self._socket(), self.traffic)
            left = self.deadline.left(0.05)
            self.client.connect(
                self.settings.hostname, self.settings.port, self.settings.user,
                sock=cast(Any, self.wire),
                timeout=left, banner_timeout=left, channel_timeout=left,
                auth_strategy=Login(self.settings, self.deadline),
                transport_factory=functools.partial(transport_for, known=known, deadline=self.deadline),
            )  # fmt: skip
        except TransportError:
            self.close()
            raise
        except (paramiko.SSHException, OSError, EOFError) as error:
            failure = self._in_words(error)
            self.close()
            raise failure from error
        self.transport = cast(LocalStreamTransport, self.client.get_transport())
        self.transport.set_keepalive(sockets.KEEPALIVE_S)
        self.forwards = ReverseForwards(self.transport)
        self.traffic.connections += 1

    def _socket(self) -> Any:  # noqa: ANN401 - a socket, or a channel of the jump host
        """Return a stream to the robot's sshd: straight, through a ProxyCommand, or through jump hosts."""
        settings = self.settings
        if settings.proxy_command:
            self.proxy = sockets.ProxyProcess(settings.name, settings.proxy_command)
            return self.proxy.socket
        if not settings.proxy_jump:
            return self._dialled or dial(settings, self.deadline)
        self.jump = jump_host(settings, self.deadline, self.trail)
        try:
            return self.jump.transport.open_channel(
                "direct-tcpip", (settings.hostname, settings.port), ("127.0.0.1", 0), timeout=self.deadline.left(0.05)
            )
        except paramiko.SSHException as error:
            raise ConnectError(
                settings.name,
                f"jump host {settings.proxy_jump[-1]} cannot reach {settings.hostname} port {settings.port}: {error}",
                hint="is the robot on, and does the jump host allow TCP forwarding?",
                code=Code.SSH_CONFIG,
            ) from None

    def _in_words(self, error: Exception) -> TransportError:
        """Say what went wrong before the login."""
        name, where = self.settings.name, f"{self.settings.hostname} port {self.settings.port}"
        transport = self.client.get_transport()
        words = f"{transport.remote_version}".strip() if transport else ""
        if self.proxy and (complaints := self.proxy.complaints()):
            return ConnectError(
                name, f"ProxyCommand failed: {complaints}", hint="try the command by hand", code=Code.SSH_CONFIG
            )
        if flooded := next((one for one in (error, error.__context__) if isinstance(one, Flooded)), None):
            return ConnectError(
                name,
                f"{where}: {flooded}",
                hint="what listens there? --exclude leaves the robot out",
                code=Code.HANDSHAKE,
            )
        if self.deadline.passed:
            stage = "finish the key exchange" if words else "send an SSH banner"
            return DeadlineError(
                name,
                f"{where} did not {stage} within {self.deadline.seconds:g} s",
                hint="is it overloaded, or no sshd at all?",
            )
        if isinstance(error, paramiko.ssh_exception.IncompatiblePeer):
            return ConnectError(
                name, f"{where}: no common algorithm ({error})", hint="update sshd on the robot", code=Code.HANDSHAKE
            )
        if not words:
            return Dropped(
                name,
                f"{where} closed the connection before its banner",
                hint="raise MaxStartups in sshd_config?",
                code=Code.HANDSHAKE,
            )
        return Dropped(
            name, f"{where}: connection lost during the key exchange ({error})", hint="try again", code=Code.LOST
        )

    def close(self) -> None:
        """End the connection, its jump host and its proxy; safe to call twice."""
        self.client.close()
        if self.wire:
            self.wire.close()
        if self.jump:
            self.jump.close()
        if self.proxy:
            self.proxy.close()
        self.jump = self.proxy = None


class Dropped(ConnectError):
    """sshd hung up before the login, as it does at random beyond MaxStartups; worth another try."""


def jump_host(settings: SshSettings, deadline: Deadline, trail: tuple[str, ...] = ()) -> StrictConnection:
    """Connect to the last of the jump hosts, through those before it.

    As `ssh -J` does, each has its own ssh_config entry, keys and user; unlike it, options that say where host keys are
    found (UserKnownHostsFile and its kin) hold for jump hosts too, as an inventory has no other place for them.

    Raises:
        TransportError: One of them cannot be reached; the message names it.
    """
    *before, last = settings.proxy_jump
    if last in trail or len(trail) > _MOST_HOPS:
        wrong = f"ProxyJump leads in a circle: {' > '.join((*trail, last))}"
        raise ConnectError(settings.name, wrong, hint="correct ProxyJump in ssh_config", code=Code.SSH_CONFIG)
    user, address, port = parse_hop(last)
    way = ",".join(before).replace("%", "%%")  # it is expanded already, and would be once more, for the jump host
    options = (*settings.inherited, *((("proxyjump", way),) if way else ()))
    host = Host(name=address, address=address, port=port, user=user, ssh_options=options)
    hop = resolve(host, ssh_config=settings.ssh_config)
    connection = StrictConnection(hop, deadline, Traffic(), (*trail, last))
    try:
        connection.open()
    except TransportError as error:
        raise type(error)(
            settings.name, f"jump host {last}: {error.message}", code=error.code, hint=error.hint
        ) from None
    return connection


def parse_hop(text: str) -> tuple[str | None, str, int | None]:
    """Cut `[user@]host[:port]` or `ssh://…` into user, host and port; `[::1]:22` is an IPv6 address with a port."""
    text = text.removeprefix("ssh://").rstrip("/")
    user, _, place = text.rpartition("@")
    found = re.fullmatch(r"\[(.+)\](?::(\d+))?|([^:]+)(?::(\d+))?|(.+)", place)
    if not found:
        return user or None, place, None
    port = found[2] or found[4]
    return user or None, found[1] or found[3] or found[5], int(port) if port else None


def open_connection(way: Way, traffic: Traffic, attempts: int) -> StrictConnection:
    """Connect; again when sshd dropped the connection before the login.

    Raises:
        TransportError: As `StrictConnection.open`.
    """
    dialled = way.socket
    for attempt in range(1, attempts + 1):
        connection = StrictConnection(way.settings, way.deadline, traffic, dialled=dialled)
        dialled = None
        try:
            connection.open()
        except Dropped:
            pause = random.uniform(0.1, 0.4) * 2**attempt  # noqa: S311 - spreads retries, guards nothing
            if attempt == attempts or pause > way.deadline.left():
                raise
            time.sleep(pause)
        else:
            return connection
    raise AssertionError("attempts is at least 1")
