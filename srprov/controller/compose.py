"""An experiment, or a plan of one, for other tools: read the files, place the services, convert.

No robot is asked here. The values of variables of the controller's environment are not read, and those of secrets
neither.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection, Iterator, Mapping
from typing import TYPE_CHECKING

import msgspec
from msgspec.structs import replace

from srprov import disk, plain_tar
from srprov.codes import Code
from srprov.controller.compose_files import env_files, texts
from srprov.controller.compose_plan import (
    addresses_of,
    check_pins,
    check_same,
    edf_of,
    told_of_placement,
    underlays,
)
from srprov.controller.own_files import COPIED_FIRST, permit_copies
from srprov.controller.robots_words import at_home
from srprov.controller.source import read_definitions, saved_plan
from srprov.controller.trial_values import at_first_point
from srprov.definitions.containermodel import ContainerDefinition
from srprov.definitions.expand import expand
from srprov.definitions.model import Definitions, Experiment
from srprov.errors import DefinitionError, UsageError
from srprov.exporting import Wanted, export
from srprov.exporting.model import Export, Lent
from srprov.exporting.reach import as_written
from srprov.exporting.variables import Open
from srprov.images.tag import Checkouts, no_repositories
from srprov.planning.policy import Permission, permissions, require

if TYPE_CHECKING:
    from srprov.controller.request import PlanRequest
    from srprov.definitions.model import Inventory
    from srprov.facts.model import Snapshot
    from srprov.planning.planfile import PlanFile

_NO_FOLDER = "or mount it `:ro` where the service only reads it; `apply` fills a volume of the engine's with the seed"
_NOT_THERE = (*COPIED_FIRST, "env", "secret", "secret-command", "fetch", "playbook", "unit")
"""Kinds that a machine which runs Compose is not asked for: whoever uses the files gives it, or it is left out."""


class Source(msgspec.Struct, frozen=True, kw_only=True):
    """What is to be exported."""

    file: str
    """The EDF."""
    definitions: Definitions
    """With the first value of each parameter."""
    open: Open
    allowed: frozenset[str]
    plan: PlanFile | None = None
    """The plan whose placement holds."""
    every_profile: bool = False
    """No profile was named: services keep theirs, where Compose can still choose."""
    tool: str = "compose"
    """What it is exported for."""
    lossy: bool = False
    """What would be refused is left out."""
    told: Mapping[str, str] = msgspec.field(default_factory=dict)
    """Robot -> what is said of its address, which only a file says."""


def read(file: str, allowed: frozenset[str], profiles: tuple[str, ...] = (), *, placed: bool = False) -> Source:
    """Read an EDF, or a plan that `plan -o` wrote with the EDF that it was made from.

    Args:
        file: The one or the other.
        allowed: Kinds of permission that the user gave.
        profiles: Of services that are wanted beside those that always are.
        placed: Services will be placed on robots: only those that are wanted.

    Raises:
        DefinitionError, UsageError, RefusedError: As for `plan`; or the EDF is not that of the plan.
    """
    plan, open_ = saved_plan(file), Open()
    edf = edf_of(plan, file) if plan else file
    keep = not (profiles or placed or plan)
    found = read_definitions(edf, allowed, ("*",) if keep or plan else profiles, environ=open_)
    if found.unsupported:
        raise DefinitionError(found.unsupported)
    if plan:
        check_same(plan, found, file)
    permit_copies(found, allowed)
    return Source(
        file=edf, definitions=at_first_point(found), open=open_, allowed=allowed, plan=plan, every_profile=keep
    )


def twin(source: Source) -> Export:
    """Return one Compose file with all services, for one PC."""
    experiment = source.definitions.experiment
    once = {name: replace(one, per_robot=None) for name, one in experiment.services.items()}
    return _exported(source, expand(replace(experiment, services=once), {}), {}, {})


def on_planned_robots(source: Source, snapshot: Snapshot | None = None) -> Export:
    """Return a Compose file for each robot of the plan; `snapshot` says where they are, else the plan if it may.

    Raises:
        UsageError: The plan places what the EDF does not have; or an address is not known.
    """
    assert source.plan is not None
    placed = dict(source.plan.plan.assignment)
    experiment = expand(source.definitions.experiment, {}, placed)
    if unknown := sorted(placed.keys() - experiment.services.keys()):
        raise UsageError(
            f"the plan places {', '.join(unknown[:5])}, which the EDF does not have", code=Code.PLAN_MISFIT
        )
    check_pins(source.plan, experiment)
    return on_robots(source, experiment, placed, underlays(snapshot) if snapshot else addresses_of(source.plan))


def on_chosen_robots(
    source: Source, inventory: Inventory, snapshot: Snapshot, request: PlanRequest, decided: object = None
) -> Export:
    """Return a Compose file for each robot that runs something, with robots chosen as `assign` does.

    Args:
        source: What was read.
        inventory: The robots.
        snapshot: As they are.
        request: How robots are chosen.
        decided: What a run's record says of its decision; None: it is decided now.

    Raises:
        NoAssignment, UsageError: As for `assign`.
        RefusedError: It would copy files of the inventory's.
    """
    from srprov.assignment import solve
    from srprov.controller.choice import checked_choice, idle_notes, read_decided

    permit_copies(source.definitions, source.allowed, inventory)
    before = None
    if decided is not None:
        before, request = read_decided(decided, request)
    choice = checked_choice(source.definitions, inventory, snapshot, request, before)
    placed = solve.solve(choice.problem, request.search_limit_s).placed
    experiment = at_home(choice.experiment, placed, snapshot.facts)
    notes = idle_notes(source.definitions, choice.experiment, snapshot)
    known = replace(source.definitions, notes=(*source.definitions.notes, *notes))
    return on_robots(replace(source, definitions=known), experiment, placed, underlays(snapshot))


def on_robots(
    source: Source, experiment: Experiment, placed: Mapping[str, str], addresses: Mapping[str, str]
) -> Export:
    """Return a Compose file for each robot that runs something.

    Args:
        source: What was read.
        experiment: With every instance as a service of its own.
        placed: Service -> robot.
        addresses: Robot -> the address that other robots reach, as far as known.
    """
    services = {name: experiment.services[name] for name in placed}
    return _exported(source, replace(experiment, services=services), placed, addresses)


def _exported(
    source: Source, experiment: Experiment, placed: Mapping[str, str], addresses: Mapping[str, str]
) -> Export:
    used = {one.cdf for one in experiment.services.values()}
    containers = {key: one for key, one in source.definitions.containers.items() if key in used}
    notes = *_granted(source, experiment, placed), *_told(source, experiment, placed)
    with disk.together():
        made = _tool(source.tool)(
            Wanted(
                definitions=replace(source.definitions, experiment=experiment, containers=containers),
                placed=placed, robots=addresses, profiles=source.every_profile, open=source.open,
                env_files=env_files(source.definitions, source.open),
                texts=texts(source.definitions, source.file), edf=source.file,
                notes=(*source.definitions.notes, *notes),
                listing=disk.listing, read=disk.read, shipped=functools.cache(_shipped),
                checkout=_checkout(containers, source.allowed), lossy=source.lossy,
            )
        )  # fmt: skip
    _permit_lent(made.lent, source.allowed)
    return made


def _permit_lent(lent: Collection[Lent], allowed: Collection[str]) -> None:
    """Refuse to lend folders of the export to containers unasked: to `apply` they are volumes, and need no permission.

    Raises:
        RefusedError: Names each of them.
    """
    require([Permission(kind="host-path", service=one.service, what=one.what) for one in lent], allowed, _NO_FOLDER)


def _granted(source: Source, experiment: Experiment, placed: Mapping[str, str]) -> Iterator[str]:
    """Yield a note for each permission that `apply` would ask for of what is written: other tools ask for none."""
    experiment = as_written(experiment, placed) if source.tool == "compose" else experiment
    of = {name: one.instance_of or name for name, one in experiment.services.items()}
    asked = permissions(experiment, source.definitions.containers)
    told = {(of.get(one.service, one.service), one.kind, one.what): None for one in asked if one.kind not in _NOT_THERE}
    for name, kind, what in told:
        tool = source.tool.capitalize()
        yield f"{name} gets more than its container, and {tool} asks nobody: {kind} ({what})"


def _told(source: Source, experiment: Experiment, placed: Mapping[str, str]) -> Iterator[str]:
    """Yield what is said of addresses, where the tool writes any, and of who runs what."""
    robots = set(placed.values()) & source.told.keys() if source.tool != "kubernetes" else set()
    yield from (source.told[robot] for robot in sorted(robots))
    if source.plan and placed:
        yield from told_of_placement(source.plan, experiment, source.definitions.experiment)


def _tool(name: str) -> Callable[[Wanted], Export]:
    if name == "swarm":
        from srprov.exporting.swarm import export as for_swarm

        return for_swarm
    if name == "kubernetes":
        from srprov.exporting.kubernetes import export as for_kubernetes

        return for_kubernetes
    return export


def _shipped(path: str) -> tuple[plain_tar.Member, ...]:
    return tuple(plain_tar.members(disk.tree_tar(path)))


def _checkout(containers: Mapping[str, ContainerDefinition], allowed: Collection[str]) -> Checkouts:
    if {"all", "git"}.isdisjoint(allowed) or not any(one.repositories for one in containers.values()):
        return no_repositories
    from srprov.controller.repositories import Repositories

    return Repositories(containers.values()).checkout
