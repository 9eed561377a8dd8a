"""`srprov export`: an experiment for Docker Compose, Docker Swarm, or Kubernetes."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import click
from msgspec.structs import replace

from srprov.cli import fork_options, inputs, options
from srprov.cli.output import counted, err, out, out_json, tell_unreachable
from srprov.cli.output_options import no_link
from srprov.cli.stored_facts import FACTS, stored_facts
from srprov.codes import Code
from srprov.controller.request import PlanRequest
from srprov.errors import UsageError, visible

if TYPE_CHECKING:
    from srprov.controller.compose import Source
    from srprov.definitions.model import Inventory
    from srprov.exporting.model import Export
    from srprov.facts.model import Snapshot


_F = TypeVar("_F", bound=Callable[..., object])
_ROBOTS = click.option("-i", "--inventory", "inventories", multiple=True, metavar="FILE",
                       help="Inventory, may be repeated; a PLAN of this machine needs none.")  # fmt: skip
_FOLDER = click.option("-o", "--out", "target", type=click.Path(path_type=Path), required=True, metavar="DIR",
                       callback=no_link, help="A folder that is new or empty.")  # fmt: skip


def _for_cluster(engine: str) -> Callable[[_F], _F]:
    """Return what adds the argument and the options of an export for an engine that has nodes of its own."""
    file = click.argument("file", metavar="EDF|PLAN")
    lossy = click.option("--lossy", is_flag=True, help=f"Leave out what {engine} cannot do, instead of refusing it.")
    given = (file, _ROBOTS, FACTS, _FOLDER, lossy, options.JSON, fork_options.FORKS, options.TIMEOUT,
             options.ASK_BECOME, options.deciding, options.ALLOW)  # fmt: skip

    def with_options(function: _F) -> _F:
        return functools.reduce(lambda verb, add: add(verb), reversed(given), function)

    return with_options


@click.group()
def export() -> None:
    """Write an experiment for other tools."""


@export.command()
@click.argument("file", metavar="EDF|PLAN")
@click.option("-i", "--inventory", "inventories", multiple=True, metavar="FILE",
              help="Inventory, may be repeated: one file per robot. Without it, there is one for a PC.")  # fmt: skip
@FACTS
@click.option("--twin", is_flag=True, help="One file for a single PC, whatever inventory is configured.")
@_FOLDER
@options.JSON
@fork_options.FORKS
@options.TIMEOUT
@options.ASK_BECOME
@options.deciding
@options.ALLOW
def compose(
    file: str, inventories: tuple[str, ...], stored: Path | None, twin: bool, target: Path, as_json: bool,
    forks: int, timeout: float, request: PlanRequest, allow: tuple[str, ...],
) -> int:  # fmt: skip
    """Write Docker Compose files with all that they need: what is built, what is shipped, and a README.

    Each field of the experiment is the same in Compose, adapted, dropped or refused; the report says which, and where
    it is written. A refused one writes nothing. Robots are chosen as by `assign`, or are those of the PLAN. Values of
    secrets and of variables that the EDF only names are never read: the README says what must be given.
    """
    from srprov.cli.permitted import permitted
    from srprov.controller import compose as controller

    _check_free(target)
    if stored and (twin or not inventories):
        raise UsageError("--facts is for the robots of an inventory", hint="name it with -i", code=Code.OPTIONS)
    source = controller.read(file, permitted(allow)[1], request.profiles, placed=bool(inventories) and not twin)
    if source.plan and not twin:
        made = _on_planned(source, inventories, stored, timeout, forks)
    elif inventories and not twin:
        made = _on_robots(source, inventories, stored, request, timeout, forks)
    else:
        made = controller.twin(source)
    return _write(made, target, as_json=as_json)


@export.command()
@_for_cluster("Swarm")
def swarm(
    file: str, inventories: tuple[str, ...], stored: Path | None, target: Path, lossy: bool, as_json: bool,
    forks: int, timeout: float, request: PlanRequest, allow: tuple[str, ...],
) -> int:  # fmt: skip
    """Write a stack for Docker Swarm, with scripts that build its images and deploy it in the order of its start.

    Services are pinned to the robots that `assign` or the PLAN chooses; the swarm's nodes must have the robots' names.
    Each field of the experiment is the same, adapted, dropped or refused; the report says which, and where it is
    written. A refused one writes nothing, unless --lossy. Values of secrets are never read.
    """
    made = _placed(_source("swarm", file, target, request, allow, lossy), inventories, stored, request, timeout, forks)
    return _write(made, target, as_json=as_json)


@export.command()
@_for_cluster("Kubernetes")
def kubernetes(
    file: str, inventories: tuple[str, ...], stored: Path | None, target: Path, lossy: bool, as_json: bool,
    forks: int, timeout: float, request: PlanRequest, allow: tuple[str, ...],
) -> int:  # fmt: skip
    """Write manifests for Kubernetes, with a script that applies them in the order of the experiment's start.

    Pods have the selector of the node that `assign` or the PLAN chooses; nodes must have the robots' names as their
    label kubernetes.io/hostname. Each field of the experiment is the same, adapted, dropped or refused; the report says
    which, and where it is written. A refused one writes nothing, unless --lossy. Values of secrets are never read.
    """
    source = _source("kubernetes", file, target, request, allow, lossy)
    return _write(_placed(source, inventories, stored, request, timeout, forks), target, as_json=as_json)


def _source(tool: str, file: str, target: Path, request: PlanRequest, allow: tuple[str, ...], lossy: bool) -> Source:
    """Read an experiment that is exported for a tool that needs robots."""
    from srprov.cli.permitted import permitted
    from srprov.controller import compose as controller

    _check_free(target)
    source = controller.read(file, permitted(allow)[1], request.profiles, placed=True)
    return replace(source, tool=tool, lossy=lossy)


def _placed(
    source: Source, inventories: tuple[str, ...], stored: Path | None, request: PlanRequest, timeout: float, forks: int
) -> Export:
    if source.plan:
        return _on_planned(source, inventories, stored, timeout, forks)
    if not inventories:
        raise UsageError(
            "no robots", hint="name an inventory with -i, or give a plan that `srprov plan -o` wrote", code=Code.OPTIONS
        )
    return _on_robots(source, inventories, stored, request, timeout, forks)


def _check_free(target: Path) -> None:
    if target.exists() and (not target.is_dir() or os.listdir(target)):
        raise UsageError(f"{target} is there and not empty", hint="name a new folder with -o", code=Code.IN_THE_WAY)


def _write(made: Export, target: Path, *, as_json: bool) -> int:
    from srprov.exporting import folder

    folder.write_export(str(target), made)
    _tell(made, target, as_json=as_json)
    return 0


def _on_robots(
    source: Source, inventories: tuple[str, ...], stored: Path | None, request: PlanRequest, timeout: float, forks: int
) -> Export:
    """Place the services as `assign` does, and return a Compose file per robot."""
    from srprov.controller import compose as controller

    inventory = inputs.load_inventory(inventories)
    snapshot, decided = _robots(inventory, stored, timeout, forks)
    source = _with_addresses(source, snapshot, inventory, stored)
    return controller.on_chosen_robots(source, inventory, snapshot, request, decided)


def _on_planned(
    source: Source, inventories: tuple[str, ...], stored: Path | None, timeout: float, forks: int
) -> Export:
    """Return what is for the robots of a plan. Where those are is their own word, unless it was written here.

    Files of an inventory that was named are not copied unasked, as of an EDF.
    """
    from srprov.controller import compose as controller
    from srprov.controller.compose_plan import is_of_here
    from srprov.controller.own_files import permit_copies

    if not inventories:
        return controller.on_planned_robots(source)
    inventory = inputs.load_inventory(inventories)
    permit_copies(source.definitions, source.allowed, inventory)
    if source.plan and is_of_here(source.plan):
        return controller.on_planned_robots(source)
    snapshot = _robots(inventory, stored, timeout, forks)[0]
    tell_unreachable(snapshot.unreachable)
    return controller.on_planned_robots(_with_addresses(source, snapshot, inventory, stored), snapshot)


def _with_addresses(source: Source, snapshot: Snapshot, inventory: Inventory, stored: Path | None) -> Source:
    from srprov.controller.compose_plan import told_of_addresses

    return replace(source, told=told_of_addresses(snapshot, inventory, str(stored))) if stored else source


def _robots(inventory: Inventory, stored: Path | None, timeout: float, forks: int) -> tuple[Snapshot, object]:
    """Return the robots as they are, and what a run's record says of its decision."""
    if stored:
        return stored_facts(stored, inventory)
    with inputs.connect(inventory, timeout, forks) as fleet:
        from srprov.facts.gather import Detail

        return fleet.gather(Detail.TRAFFIC), None


def _tell(made: Export, target: Path, *, as_json: bool) -> None:
    from srprov.exporting.report import report_json, report_lines

    if as_json:
        out_json(report_json(made))
        return
    for note in made.notes:
        err(f"note: {visible(note)}")
    out("\n".join(report_lines(made)))
    for need in made.needs:
        out(visible(f"you must give the {need.kind} {need.name}: {need.what}"))
        if need.command:
            out(visible(f"  in the export: {need.command}"))
    files = dict.fromkeys(f"{one.folder}{one.file}" for one in made.machines)
    out(f"{target}: {', '.join(files)}, and {counted(len(made.files) - len(files), 'file')} beside")
