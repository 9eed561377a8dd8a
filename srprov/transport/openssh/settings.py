"""How one host is reached, as a value. `resolve.py` makes it; everything else in this folder reads it."""

from __future__ import annotations

import socket
from dataclasses import dataclass, field
from pathlib import Path

from srprov.secret import Secret


@dataclass(frozen=True, kw_only=True, slots=True)
class SshSettings:
    """All that a connection needs to know, with `~` and %-tokens expanded."""

    name: str
    """The robot's name in the inventory."""
    address: str
    """What the inventory gives for it, as ssh_config knows it."""
    hostname: str
    port: int = 22
    user: str
    identity_files: tuple[str, ...] = ()
    """In the order in which they are tried; the default ones when nothing is configured."""
    identities_configured: bool = False
    identities_only: bool = False
    identity_agent: str | None = None
    """Socket of the agent, None for none."""
    password: Secret | None = None
    known_hosts: tuple[str, ...] = ()
    """UserKnownHostsFile; the first is the one that accept-new adds to."""
    global_known_hosts: tuple[str, ...] = ()
    revoked_host_keys: str | None = None
    host_key_alias: str | None = None
    accept_new: bool = False
    asked_for_no: bool = False
    """StrictHostKeyChecking=no was asked for, and is not done."""
    hash_known_hosts: bool = False
    proxy_jump: tuple[str, ...] = ()
    proxy_command: str | None = None
    address_family: int = socket.AF_UNSPEC
    connect_timeout_s: float | None = None
    ssh_config: Path | None = None
    """The file that was read instead of the usual ones; jump hosts are looked up there too."""
    inherited: tuple[tuple[str, str], ...] = field(default=(), repr=False)
    """The options that a jump host on the way takes over: where its host key may be found."""

    @property
    def known_hosts_named(self) -> bool:
        """Tell whether the inventory says which files of host keys count, and not the user's own ssh_config."""
        return any(key == "userknownhostsfile" for key, _ in self.inherited)
