"""Options that several verbs share, and what they stand for: definitions, the inventory, open sessions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import click

from srprov.errors import UsageError
from srprov.wire import Session

if TYPE_CHECKING:
    from srprov.definitions.model import Definitions, Inventory
    from srprov.transport.pool import Sessions

_F = TypeVar("_F", bound=Callable[..., Any])

INVENTORY = click.option(
    "-i", "--inventory", "inventories", multiple=True, required=True, metavar="FILE", help="Inventory; may be repeated."
)
FORKS = click.option(
    "-f", "--forks", type=click.IntRange(min=1), default=64, show_default=True, help="Robots at the same time."
)
INSTANCE = click.option("--instance", default="", metavar="ID", help="Instance id (default: the experiment's name).")
JSON = click.option("--json", "as_json", is_flag=True, help="One JSON document on stdout, all else on stderr.")
TIMEOUT = click.option(
    "--timeout",
    type=click.FloatRange(min=0.1),
    default=10.0,
    show_default=True,
    metavar="S",
    help="Seconds to connect to a robot.",
)
LIMIT = click.option("--limit", default="", metavar="PATTERN", help="Change only these robots (Ansible pattern).")
EXCLUDE = click.option("--exclude", default="", metavar="PATTERN", help="Do not change these robots.")


def quietly_robots(function: _F) -> _F:
    """Add the options of a verb that streams text from robots: no JSON, and `-f` is left for --follow."""
    forks = click.option(
        "--forks", type=click.IntRange(min=1), default=64, show_default=True, help="Robots at the same time."
    )
    for option in (TIMEOUT, forks, INVENTORY):
        function = option(function)
    return function


def robots(function: _F) -> _F:
    """Add the options of every verb that talks to robots."""
    for option in (TIMEOUT, FORKS, JSON, INVENTORY):
        function = option(function)
    return function


@dataclass(frozen=True, slots=True)
class Lab:
    """The inventory with open sessions."""

    inventory: Inventory
    sessions: Sessions

    def connected(self) -> Mapping[str, Session]:
        """Give the sessions of robots that could be reached."""
        return self.sessions.connected()


def load_inventory(paths: tuple[str, ...]) -> Inventory:
    """Read the inventory; an empty one is an error."""
    from srprov import definitions

    lab = definitions.load_inventory(list(paths))
    if not lab.hosts:
        raise UsageError(f"no robots in {', '.join(paths)}", hint="add hosts to the inventory")
    return lab


def load_experiment(path: str) -> Definitions:
    """Read an EDF and its CDFs."""
    from srprov import definitions

    return definitions.load_experiment(path)


@contextmanager
def open_lab(inventory: Inventory, timeout: float, forks: int) -> Iterator[Lab]:
    """Begin to connect to all robots; connections end with the block."""
    from srprov.transport import ConnectOptions
    from srprov.transport.pool import Sessions

    with Sessions(inventory.hosts, options=ConnectOptions(connect_timeout_s=timeout), forks=forks) as sessions:
        yield Lab(inventory, sessions)


def selected(inventory: Inventory, limit: str, exclude: str) -> frozenset[str]:
    """Give the robots that may be changed."""
    from srprov.definitions.patterns import select

    chosen = set(select(inventory, limit)) if limit else set(inventory.hosts)
    if exclude:
        chosen -= set(select(inventory, exclude))
    if not chosen:
        raise UsageError("--limit and --exclude leave no robot", hint=f"known: {', '.join(inventory.hosts)}")
    return frozenset(chosen)
