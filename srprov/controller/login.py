"""A login on one robot of an inventory, by the rules of every other connection. Takes a robot; gives its streams."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from srprov.codes import Code
from srprov.errors import UsageError, did_you_mean
from srprov.wire import quote

if TYPE_CHECKING:
    from srprov.definitions.model import Host, Inventory
    from srprov.session import ContainerCommand


def robot_of(inventory: Inventory, name: str) -> Host:
    """Return a robot by its name.

    Raises:
        UsageError: There is none of that name, or it is this machine.
    """
    host = inventory.hosts.get(name)
    if host is None:
        hint = did_you_mean(name, inventory.hosts) or f"there are: {', '.join(list(inventory.hosts)[:20])}"
        raise UsageError(f"the inventory has no robot {name[:80]}", hint=hint, code=Code.NO_MATCH)
    if host.connection == "local":
        raise UsageError(
            f"{name} is this machine (ansible_connection: local)",
            hint="a terminal of yours is there",
            code=Code.NO_MATCH,
        )
    return host


def log_in(host: Host, command: Sequence[str], *, terminal: str, timeout_s: float) -> ContainerCommand:
    """Log in and start a command, or the user's own shell.

    Args:
        host: The robot.
        command: Its words, which the user's shell gets as they are; none: the shell itself.
        terminal: What kind of terminal it gets; empty: none.
        timeout_s: To connect.

    Raises:
        TransportError: The robot cannot be reached, is not the one that is known, or lets nobody in.
    """
    from srprov.transport import ConnectOptions, log_in

    words = " ".join(quote(word) for word in command)
    return log_in(host, words, terminal, options=ConnectOptions(connect_timeout_s=timeout_s))
