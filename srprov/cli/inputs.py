"""What verbs start from: definitions, the inventory, the chosen robots, and open sessions with all of them."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click
from msgspec.structs import replace

from srprov.cli.config import user_folder
from srprov.cli.fork_options import sharing
from srprov.cli.options import asked_for_become
from srprov.cli.output import catch_logs, err
from srprov.cli.output_options import is_quiet, note
from srprov.cli.whose_inventory import inventory_set_aside, unnamed_inventories
from srprov.codes import Code
from srprov.controller.request import PlanRequest
from srprov.errors import DefinitionError, RefusedError, UsageError, visible
from srprov.names import few
from srprov.secret import Secret, Vault

if TYPE_CHECKING:
    from srprov.controller.fleet import Fleet
    from srprov.definitions.model import Definitions, Experiment, Inventory
    from srprov.facts.model import Snapshot

_LATE_S = 3.0
"""After this time without an answer a robot is named."""
_MOST_NAMED = 8


def load_inventory(paths: tuple[str, ...]) -> Inventory:
    """Read the inventory; an empty one is an error. Asks for sudo's password when the user said so.

    An inventory may run programs here only when the user named it: on the command line, or by an absolute path or as
    robots by name in the environment or his own configuration. A relative path there lies in whatever folder this is.
    """
    from srprov.definitions import load_inventory as load

    _refuse_changed(paths)
    context = click.get_current_context(silent=True)
    if context and (aside := inventory_set_aside(context, paths)):
        own = ", ".join(paths).rstrip(",")
        err(f"note: the inventory is {own}, of your own configuration; that of {visible(aside)} needs -i")
    inventory = load(list(paths), unnamed=unnamed_inventories(context, paths))
    if inventory.strange_record:
        told = f"note: {visible(inventory.strange_record)} is not known as of a run here whose inventory you named"
        err(f"{told}: it says only where robots are; to trust it, copy it elsewhere")
    if not inventory.hosts:
        raise UsageError(f"no robots in {', '.join(paths)}", hint="add hosts to the inventory", code=Code.NO_ROBOT)
    return _with_become_password(inventory) if asked_for_become() else inventory


def _refuse_changed(paths: tuple[str, ...]) -> None:
    """Refuse an inventory of a lab that `lab up` did not write: whoever named it means that one."""
    from srprov.lab.written import changed

    if path := changed(paths):
        raise UsageError(
            f"{os.path.relpath(path)} is not what `srprov lab up` wrote, and may be a stranger's, as by `git pull`",
            hint="remove it, or rename one of your own, and `srprov lab up` in this folder writes it anew",
            code=Code.STRANGE_FILE,
        )


def _with_become_password(inventory: Inventory) -> Inventory:
    """Ask once, and give the answer to every robot that has no password of its own, and where root does not log in.

    Raises:
        UsageError: Some would be told it of an inventory that the user did not name: one may be called as one of his.
        RefusedError: There is no terminal to ask on.
    """
    lacking = [name for name, host in inventory.hosts.items() if not host.become_password and host.user != "root"]
    if not lacking:
        return inventory
    if not inventory.named:
        whose, hint = "an inventory that you did not name", "name it yourself: -i FILE"
        if inventory.strange_record:
            whose, hint = "a record that may be a stranger's", "copy it elsewhere, and name the copy"
        message = f"-K would tell sudo's password to robots of {whose}"
        raise UsageError(message, hint=f"if you trust it, {hint}", code=Code.UNNAMED_INVENTORY)
    if not sys.stdin.isatty():
        hint = "set ansible_become_password in the inventory, e.g. in host_vars/ that only you can read"
        raise RefusedError("there is no terminal to ask for sudo's password on", hint=hint, code=Code.NO_TERMINAL)
    err(f"sudo's password is told any of these that asks: {few(lacking, _MOST_NAMED)}")
    try:
        password = Secret(click.prompt("sudo password", hide_input=True, err=True, default="", show_default=False))
    except ValueError as error:
        raise UsageError(str(error), code=Code.OPTION_VALUE) from None
    given = {name: replace(inventory.hosts[name], become_password=password) for name in lacking}
    return replace(inventory, hosts={**inventory.hosts, **given})


def load_chosen(paths: tuple[str, ...], limit: str, exclude: str) -> Inventory:
    """Read the inventory and return it with the chosen robots alone."""
    whole = load_inventory(paths)
    chosen = selected(whole, limit, exclude)
    return replace(whole, hosts={name: host for name, host in whole.hosts.items() if name in chosen})


def load_experiment(path: str, wanted: Collection[str] = ("*",), allowed: Collection[str] = ()) -> Definitions:
    """Read an EDF and its CDFs, with the services of the wanted profiles, by default of all.

    Files that are not the experiment's own are looked at when `allowed` has that kind of permission.
    """
    from srprov.definitions import load_experiment as load

    return load(path, profiles=wanted, outside=not {"outside", "all"}.isdisjoint(allowed))


def experiment_if_valid(path: str) -> Experiment | None:
    """Read an EDF for the names of its services; one that is not valid any more gives None."""
    try:
        return load_experiment(path).experiment
    except DefinitionError:
        return None


def named_instance(file: str | None, instance: str) -> tuple[str, str]:
    """Return the instance's id and, when an EDF is named, its source; the EDF need not be valid any more for that.

    Raises:
        UsageError: Neither an EDF nor --instance is given.
    """
    if file is None:
        if not instance:
            raise UsageError("which experiment?", hint="name its EDF, or --instance ID", code=Code.WHICH)
        return instance, ""
    from srprov.controller.owners import read_owner, with_bundle
    from srprov.controller.source import named_instance as named

    name, source = named(file)
    name = instance or name
    return name, with_bundle(source, read_owner(name, file))


def tell_maker(snapshot: Snapshot, instance: str, source: str) -> None:
    """Say which other experiment made an instance that an EDF is asked for, if one did."""
    from srprov.controller.ownership import looking, made_by_another

    if source and (said := made_by_another(looking(snapshot, instance).snapshot, instance, source)):
        err(f"note: {visible(said)}")


def with_own_files(request: PlanRequest, experiment: Experiment) -> PlanRequest:
    """Return the request with who owns the instance's volumes, and the playbooks of the user's own folder."""
    from srprov.controller.owners import read_owner

    instance = request.instance or experiment.name
    request = replace(request, owner=read_owner(instance, experiment.file))
    folder = user_folder(os.environ) / "playbooks"
    if not folder.is_dir():
        return request
    from srprov.controller.playbooks import own_playbooks

    return replace(request, playbooks=own_playbooks(folder))


@contextmanager
def connect(
    inventory: Inventory, timeout: float, forks: int, *, changing: bool = False, vault: Vault | None = None
) -> Iterator[Fleet]:
    """Begin to connect to all robots; connections end with the block. See `srprov.controller.fleet.connect`."""
    from srprov.controller import fleet

    catch_logs()
    with fleet.connect(
        inventory, timeout_s=timeout, forks=forks, changing=changing, vault=vault, sharing=sharing()
    ) as connected:
        late = threading.Timer(_LATE_S, _say_awaited, (connected, timeout))
        late.daemon = True
        if not is_quiet():
            late.start()
        try:
            yield connected
        finally:
            late.cancel()


def _say_awaited(connected: Fleet, timeout: float) -> None:
    """Name the robots that have not answered yet, so that nobody wonders what is waited for."""
    if names := connected.awaited():
        err(f"waiting for {few(names, _MOST_NAMED)}: no answer yet; --timeout is {timeout:g} s")


def waited(fleet: Fleet, instance: str, seconds: float, chosen: Collection[str]) -> float:
    """Wait for other runs of the instance on the chosen robots as long as the user said; return the seconds left."""
    if seconds <= 0:
        return seconds
    from srprov.controller.waiting import wait_for_other_runs

    return wait_for_other_runs(fleet, instance, seconds, note, chosen)


def failed_robots(instance: str, runs: Path | None) -> Callable[[], frozenset[str]]:
    """Return what `@failed` stands for: the robots that the last recorded run of an instance did not finish."""

    def look() -> frozenset[str]:
        from srprov.record import default_root, last_run

        root = runs or default_root()
        last = last_run(root, instance)
        if last is None:
            hint = "--runs or SRPROV_RUNS names where runs are recorded, --instance the experiment's instance"
            raise UsageError(f"'@failed': no run of {instance} is recorded in {root}", hint=hint, code=Code.NO_RUN)
        if not last.failed:
            raise UsageError(
                f"'@failed' matches no robot: nothing failed in the last run of {instance} ({last.path.name})",
                hint="leave it out to change all robots",
                code=Code.NO_MATCH,
            )
        return last.failed

    return look


def selected(
    inventory: Inventory, limit: str, exclude: str, failed: Callable[[], Collection[str]] | None = None
) -> frozenset[str]:
    """Return the robots that may be changed; `failed` is what `@failed` stands for, for verbs with an experiment."""
    from srprov.definitions import select

    chosen = set(select(inventory, limit, failed)) if limit else set(inventory.hosts)
    if exclude:
        chosen -= set(select(inventory, exclude, failed))
    if not chosen:
        raise UsageError(
            "--limit and --exclude leave no robot", hint=f"known: {', '.join(inventory.hosts)}", code=Code.NO_ROBOT
        )
    return frozenset(chosen)
