"""Options that several verbs share, and what they stand for: definitions, the inventory, open sessions."""

from __future__ import annotations

import dataclasses
import sys
import threading
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from srprov.cli.output import catch_logs
from srprov.errors import RefusedError, UsageError
from srprov.secret import Secret, Vault
from srprov.wire import Pulse, Session

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
LIMIT = click.option(
    "--limit",
    default="",
    metavar="PATTERN",
    help="Change only these robots (Ansible pattern; @failed: those that the last run did not finish; @FILE: a list).",
)
EXCLUDE = click.option("--exclude", default="", metavar="PATTERN", help="Do not change these robots.")


def _pulse(_context: click.Context, _option: click.Parameter, text: str) -> Pulse:
    """Read `BEAT,CONTROLLER,ROBOT`, seconds each; empty is the default."""
    try:
        beat, controller, robot = text.split(",") if text else ("5", "20", "30")
        return Pulse(beat_s=float(beat), controller_s=float(controller), robot_s=int(robot))
    except ValueError as error:
        raise click.BadParameter(f"{text!r}: {error}; three numbers are wanted, e.g. 1,4,6") from None


def locking(function: _F) -> _F:
    """Add the options of every verb that changes robots."""
    wait = click.option("--lock-wait", type=click.FloatRange(min=0), default=0.0, show_default=True, metavar="S",
                        help="Seconds to wait for robots that somebody else is changing.")  # fmt: skip
    heartbeat = click.option(
        "--heartbeat", "pulse", envvar="SRPROV_HEARTBEAT", default="", callback=_pulse, hidden=True
    )
    return wait(heartbeat(function))


def _ask_become(context: click.Context, _option: click.Parameter, wanted: bool) -> None:
    """Leave the wish where `load_inventory` finds it: every verb that reads an inventory has it, none handles it."""
    context.meta[_ASK_BECOME] = wanted


_ASK_BECOME = "srprov.ask-become-pass"
ASK_BECOME = click.option(
    "-K", "--ask-become-pass", is_flag=True, expose_value=False, callback=_ask_become,
    help="Ask for sudo's password, for robots without ansible_become_password.",
)  # fmt: skip


RUNS = click.option(
    "--runs", type=click.Path(file_okay=False, path_type=Path), envvar="SRPROV_RUNS", default=None, metavar="DIR",
    help="Where runs are recorded (default: ~/.local/state/srprov/runs).",
)  # fmt: skip


UNREACHABLE = click.option(
    "--unreachable",
    type=click.Choice(["fail", "skip", "reassign"]),
    default="fail",
    show_default=True,
    help="When robots cannot be reached: do the others and exit with 4, or with 0 (skip), "
    "or place their services elsewhere (reassign).",
)
ALLOW = click.option(
    "--allow",
    multiple=True,
    metavar="KIND",
    help="Allow what the plan lists as asked for, e.g. host-network or playbook; or all.",
)
MAX_FAIL = click.option(
    "--max-fail",
    default="",
    metavar="N|N%",
    help="Begin no further step when steps failed on more robots than this.",
)


def budget(text: str, robots: int) -> int | None:
    """Read `--max-fail`: a number of robots, or a share of `robots`, rounded down.

    Raises:
        UsageError: It is neither.
    """
    if not text:
        return None
    number = text.removesuffix("%")
    if not number.isdigit() or (text.endswith("%") and int(number) > 100):
        raise UsageError(f"--max-fail takes a number of robots or a share, not '{text}'", hint="e.g. 1 or 25%")
    return int(number) * robots // 100 if text.endswith("%") else int(number)


def quietly_robots(function: _F) -> _F:
    """Add the options of a verb that streams text from robots: no JSON, and `-f` is left for --follow."""
    forks = click.option(
        "--forks", type=click.IntRange(min=1), default=64, show_default=True, help="Robots at the same time."
    )
    for option in (ASK_BECOME, TIMEOUT, forks, INVENTORY):
        function = option(function)
    return function


def robots(function: _F) -> _F:
    """Add the options of every verb that talks to robots."""
    for option in (ASK_BECOME, TIMEOUT, FORKS, JSON, INVENTORY):
        function = option(function)
    return function


@dataclass(frozen=True, slots=True)
class Lab:
    """The inventory with open sessions."""

    inventory: Inventory
    sessions: Sessions

    def connected(self) -> Mapping[str, Session]:
        """Return the sessions of robots that could be reached."""
        return self.sessions.connected()


def load_inventory(paths: tuple[str, ...]) -> Inventory:
    """Read the inventory; an empty one is an error. Asks for sudo's password when the user said so."""
    from srprov import definitions

    lab = definitions.load_inventory(list(paths))
    if not lab.hosts:
        raise UsageError(f"no robots in {', '.join(paths)}", hint="add hosts to the inventory")
    context = click.get_current_context(silent=True)
    return _with_become_password(lab) if context and context.meta.get(_ASK_BECOME) else lab


def _with_become_password(inventory: Inventory) -> Inventory:
    """Ask once, and give the answer to every robot that has no password of its own."""
    if not sys.stdin.isatty():
        hint = "set ansible_become_password in the inventory, e.g. in host_vars/ that only you can read"
        raise RefusedError("there is no terminal to ask for sudo's password on", hint=hint)
    try:
        password = Secret(click.prompt("sudo password", hide_input=True, err=True, default="", show_default=False))
    except ValueError as error:
        raise UsageError(str(error)) from None
    hosts = {
        name: host if host.become_password else dataclasses.replace(host, become_password=password)
        for name, host in inventory.hosts.items()
    }
    return dataclasses.replace(inventory, hosts=hosts)


def load_experiment(path: str) -> Definitions:
    """Read an EDF and its CDFs."""
    from srprov import definitions

    return definitions.load_experiment(path)


@contextmanager
def open_lab(
    inventory: Inventory, timeout: float, forks: int, *, locks: bool = False, vault: Vault | None = None
) -> Iterator[Lab]:
    """Begin to connect to all robots; connections end with the block.

    `locks` prepares to take their locks; `vault` has the secrets that are written there.
    """
    from srprov.transport import ConnectOptions, load_ssh
    from srprov.transport.pool import Sessions

    catch_logs()
    connecting = ConnectOptions(connect_timeout_s=timeout, vault=vault or Vault())
    with Sessions(inventory.hosts, options=connecting, forks=forks) as sessions:
        if any(host.connection != "local" for host in inventory.hosts.values()):
            load_ssh()  # before anything else is imported: from then on the robots have something to do too
        if locks:
            threading.Thread(target=_prepare_record, name="import record", daemon=True).start()
        yield Lab(inventory, sessions)


def _prepare_record() -> None:
    """Import what records a run, while connections come up."""
    from srprov.record.documents import controller

    controller()


def failed_robots(instance: str, runs: Path | None) -> Callable[[], frozenset[str]]:
    """Return what `@failed` stands for: the robots that the last recorded run of an instance did not finish."""

    def look() -> frozenset[str]:
        from srprov.record import default_root, last_run

        root = runs or default_root()
        last = last_run(root, instance)
        if last is None:
            hint = "--runs or SRPROV_RUNS names where runs are recorded, --instance the experiment's instance"
            raise UsageError(f"'@failed': no run of {instance} is recorded in {root}", hint=hint)
        if not last.failed:
            raise UsageError(
                f"'@failed' matches no robot: nothing failed in the last run of {instance} ({last.path.name})",
                hint="leave it out to change all robots",
            )
        return last.failed

    return look


def selected(
    inventory: Inventory, limit: str, exclude: str, failed: Callable[[], Collection[str]] | None = None
) -> frozenset[str]:
    """Return the robots that may be changed; `failed` is what `@failed` stands for, for verbs with an experiment."""
    from srprov.definitions.patterns import select

    known = {"failed": failed} if failed else {}
    chosen = set(select(inventory, limit, **known)) if limit else set(inventory.hosts)
    if exclude:
        chosen -= set(select(inventory, exclude, **known))
    if not chosen:
        raise UsageError("--limit and --exclude leave no robot", hint=f"known: {', '.join(inventory.hosts)}")
    return frozenset(chosen)
