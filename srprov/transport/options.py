"""How to connect, as a value, and how one session finds another."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

import msgspec

from srprov.secret import Vault
from srprov.transport.image_source import ImageSources
from srprov.transport.turns import OwnTurns, Turns

if TYPE_CHECKING:
    from pathlib import Path

    from srprov.session import Session
    from srprov.transport.blobs import Blob
    from srprov.wire import SendData

Peers = Callable[[str], "Session"]
"""Returns the session of another robot by its name, for `CopyImage`; raises TransportError when there is none."""


class HomeFiles(Protocol):
    """Files of the machine where srprov runs, for connections that another machine has."""

    def layer(self, digest: str) -> Blob | None:
        """Return a content of its cache of layers, which is in that of this machine then."""

    def data_set(self, command: SendData) -> Path:
        """Return a data set as a file of this machine."""


class ConnectOptions(msgspec.Struct, frozen=True, kw_only=True):
    """How to connect; the inventory and ssh_config say whom to and as whom."""

    connect_timeout_s: float = 10.0
    """For everything from the name lookup to the ready shell; `ConnectTimeout` of the host's ssh options wins."""
    attempts: int = 3
    """How often a connection that sshd dropped before its banner (MaxStartups) is tried, inside the timeout."""
    ssh_config: Path | None = None
    """Used instead of ~/.ssh/config and /etc/ssh/ssh_config, as `ssh -F` does."""
    warm_engine: bool = True
    """Open the channel to the Docker Engine in the background while the first questions are asked."""
    vault: Vault = msgspec.field(default_factory=Vault)
    """What the sessions put in the place of the names of secrets."""
    image_sources: ImageSources = msgspec.field(default_factory=ImageSources)
    """Where copies of images read what their robot lacks, and the cache that they keep it in."""
    turns: Turns = msgspec.field(default_factory=OwnTurns)
    """Who downloads a data set, once for all robots."""
    home: HomeFiles | None = None
    """Where files are that are not from a robot; None: on this machine."""
