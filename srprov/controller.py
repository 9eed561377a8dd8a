"""The flow on one screen: read, decide, render, compare; then, apart from it, execute.

The only file that knows the order of the rooms. `make_plan` stops before execution, so a dry run is simply not
calling `apply`.
"""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from srprov import data, rendering
from srprov.assignment import problem, solve
from srprov.assignment.model import Assignment, Problem
from srprov.context import RenderInputs, contexts
from srprov.definitions.expand import expand, nowhere
from srprov.definitions.model import ContainerDefinition, Definitions, Experiment, Inventory
from srprov.definitions.pins import unknown_pins
from srprov.definitions.playbookmodel import Playbook
from srprov.definitions.secretvalues import resolve, used
from srprov.definitions.source import source_of
from srprov.errors import DefinitionError, SrprovError
from srprov.execution import Listener, RunOptions, RunResult, run_plan
from srprov.facts.gather import Detail, Gathering, Readers, begin, gather, probe
from srprov.facts.model import Snapshot
from srprov.instance import absent, check_source, owned, previous_robots
from srprov.modules import MODULES
from srprov.modules.secret import with_value
from srprov.network.layout import Overlay, layout
from srprov.network.record import read_record, record
from srprov.planning.diff import Removal, diff, removal_plan
from srprov.planning.plan import Plan, PlaybookUse
from srprov.planning.policy import permissions, require
from srprov.resource import Resource
from srprov.secret import Vault
from srprov.wire import Session

if TYPE_CHECKING:
    from srprov.images.plan import ImagePlan


@dataclass(frozen=True, kw_only=True, slots=True)
class PlanRequest:
    """What the user asks for beside the files."""

    instance: str = ""
    """Empty: the experiment's name."""
    reassign: bool = False
    history: tuple[Mapping[str, float], ...] = ()
    """Earlier runs, each robot -> the cost that was allocated to it; for fairness."""
    adopt: bool = False
    reassign_unreachable: bool = False
    """Place services of robots that cannot be reached elsewhere."""
    forks: int = 64
    exact: bool = False
    """Ask the engines of themselves even if nothing is new: a plan file holds robots to what they said."""
    looking: Gathering | None = None
    """A look at the robots that has begun already."""
    expect: Callable[[frozenset[str]], None] = lambda _robots: None
    """Told, once, as soon as it is known that something is new, and which robots it will likely be on."""
    playbooks: tuple[Playbook, ...] = ()
    """The user's own, from his folder."""
    allow: frozenset[str] = frozenset()
    """Kinds of permission that the user gave. Only an experiment's playbooks are held to them here: to plan is to
    render them, and to ask their commands' checks."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Planned:
    """A plan with all that led to it."""

    plan: Plan
    snapshot: Snapshot
    assignment: Assignment
    overlay: Overlay
    desired: tuple[Resource, ...]
    """What should be true on all robots."""
    images: Mapping[str, ImagePlan]
    """Tag -> what is built under it; a failed build can name the line of the CDF."""
    playbooks: tuple[Playbook, ...] = ()
    """Those that users wrote, the experiment's and the user's own."""


Timer = Callable[[str], None]
"""Told the name of each phase as it begins."""


def make_plan(
    definitions: Definitions,
    inventory: Inventory,
    readers: Readers,
    request: PlanRequest,
    phase: Timer = lambda _name: None,
    vault: Vault | None = None,
) -> Planned:
    """Read the robots and say what would make the experiment true; `vault` holds the secrets (default: resolved here).

    Raises:
        DefinitionError: The files ask for what is not built yet, or for robots that are not in the inventory.
        RefusedError: The instance belongs to another source; or the experiment has playbooks that were not allowed.
        NoAssignment: There is no feasible placement.
        UsageError, RenderError, PlanError: as their rooms say.
    """
    experiment = _possible(definitions, inventory, request)
    instance, source = request.instance or experiment.name, source_of(experiment.file)
    phase("facts")
    experiment, found, previous, kept = _look(definitions, instance, inventory, readers, request)
    check_source(found, instance, source, adopt=request.adopt)
    idle = nowhere(definitions.experiment, experiment.services.values(), away=bool(found.unreachable))
    phase("assignment")
    placed = kept or solve.solve(choice_of(experiment, definitions, inventory, found, previous, request))
    phase("plan")
    overlay = layout(experiment, placed.placed, found, instance=instance)
    built, references = _images(definitions.containers)
    parts = RenderInputs(
        instance=instance,
        source=source,
        experiment=experiment,
        placed=placed.placed,
        overlay=overlay,
        images=built,
        references=references,
        record=record(overlay, experiment, placed.placed, source, found.placements.get(instance)),
        snapshot=found,
    )
    theirs = (*experiment.playbooks, *request.playbooks)
    desired = _desired(parts, theirs, vault or resolve(used(experiment)))
    found = probe(found, desired, readers, forks=request.forks)
    steps, unchanged = diff(desired, owned(found, instance), instance)
    plan = Plan(
        instance=instance,
        source=source,
        steps=steps,
        unchanged=unchanged,
        assignment=placed.placed,
        cost=placed.cost,
        costs={service: terms.total for service, terms in placed.terms.items()},
        permissions=permissions(experiment),
        secrets=used(experiment),
        notes=(*_notes(placed), *idle),
        unreachable=found.unreachable,
        playbooks=tuple(PlaybookUse(name=one.name, file=one.file, place=one.place) for one in theirs),
    )
    return Planned(
        plan=plan, snapshot=found, assignment=placed, overlay=overlay, desired=tuple(desired), playbooks=theirs,
        images={image.tag: image for image in built.values()},
    )  # fmt: skip


def _possible(definitions: Definitions, inventory: Inventory, request: PlanRequest) -> Experiment:
    """Return the experiment, or refuse what cannot be planned or must not; nothing of it was shown to a robot yet."""
    if definitions.unsupported:
        raise DefinitionError(definitions.unsupported)
    if unknown := unknown_pins(definitions.experiment, inventory):
        raise DefinitionError(unknown)
    require([one for one in permissions(definitions.experiment) if one.kind == "playbook"], request.allow)
    return definitions.experiment


def _look(
    definitions: Definitions, instance: str, inventory: Inventory, readers: Readers, request: PlanRequest
) -> tuple[Experiment, Snapshot, dict[str, str], Assignment | None]:
    """Return the experiment with all instances, all robots as they are, and where the instance's services run now.

    And the assignment, if it leaves everything where it is.
    """
    kept: list[Assignment] = []

    def closer(snapshot: Snapshot) -> Detail:
        """Only what is not there yet makes a difference to how an engine is, and only a choice needs the traffic."""
        known = previous_robots(snapshot, instance)
        whole = with_instances(definitions.experiment, snapshot, known)
        free = request.reassign or request.reassign_unreachable or not whole.placement.sticky
        new = {*absent(snapshot, instance, known, whole.services)}
        choice = functools.partial(choice_of, whole, definitions, inventory, snapshot, known, request)
        if not (free or new):
            try:
                placed = solve.solve(choice())
            except SrprovError:
                new = {*whole.services}  # to be seen again, with all that there is to know
            else:
                new = {name for name in whole.services if placed.placed[name] != known[name]}
                kept.extend([] if new else [placed])
            if not new:
                return Detail.NO
        pinned = {name: robot for name in new if (robot := whole.services[name].robot)}
        likely = {**solve.guess(choice), **pinned}
        due = [robot for name, robot in likely.items() if name in new or robot != known.get(name)]
        request.expect(frozenset(robot for robot in due if robot in snapshot.facts))
        return Detail.TRAFFIC if free or len(pinned) < len(new) else Detail.ENGINE

    looking = request.looking or begin(
        inventory, readers, definitions.experiment, exact=request.exact, forks=request.forks
    )
    found = looking.end(closer)
    previous = previous_robots(found, instance)
    return with_instances(definitions.experiment, found, previous), found, previous, kept[0] if kept else None


def with_instances(experiment: Experiment, snapshot: Snapshot, previous: Mapping[str, str]) -> Experiment:
    """Return the experiment with replicas and `per_robot` as services of their own, for the robots that were found."""
    away = {service: robot for service, robot in previous.items() if robot in snapshot.unreachable}
    return expand(experiment, {robot: facts.tags for robot, facts in snapshot.facts.items()}, away)


def choice_of(
    experiment: Experiment,
    definitions: Definitions,
    inventory: Inventory,
    snapshot: Snapshot,
    previous: Mapping[str, str],
    request: PlanRequest,
) -> Problem:
    """Return the assignment problem of an experiment that has all its instances."""
    return problem.build(
        experiment,
        definitions.containers,
        snapshot,
        previous,
        slots={name: host.slots for name, host in inventory.hosts.items() if host.slots is not None},
        reassign=request.reassign,
        reassign_unreachable=request.reassign_unreachable,
        history=request.history,
    )


def _desired(parts: RenderInputs, theirs: Sequence[Playbook], vault: Vault) -> list[Resource]:
    """Return what should be true on all robots; only after rendering a secret gets its value."""
    per_host, blobs = contexts(parts)
    every = rendering.render_all(playbooks(), theirs, per_host, modules=MODULES, blobs=blobs)
    return [with_value(resource, vault) for resource in every]


def make_removal(
    instance: str,
    inventory: Inventory,
    readers: Readers,
    *,
    volumes: bool,
    source: str = "",
    adopt: bool = False,
    forks: int = 64,
) -> tuple[Plan, Snapshot]:
    """Say what would take everything of an instance away; needs no EDF, only labels.

    Raises:
        RefusedError: `source` is given and another source made the instance.
    """
    found = gather(inventory, readers, closer=Detail.NO, forks=forks)
    if source:
        check_source(found, instance, source, adopt=adopt)
    steps = removal_plan(owned(found, instance), instance, Removal(volumes=volumes))
    known = read_record(found.placements.get(instance))
    away = sorted({robot for robot in (known.robots.values() if known else ()) if robot in found.unreachable})
    notes = tuple(
        f"{robot} holds services of this instance and cannot be reached; destroy again when it is back"
        for robot in away
    )
    kept = [
        e.name for items in found.observed.values() for e in items if e.module == "volume" and e.instance == instance
    ]
    if kept and not volumes:
        notes += (f"{len(kept)} data volume(s) stay: {', '.join(sorted(set(kept)))}; --volumes removes them",)
    made_from = known.source if known else source
    return Plan(instance=instance, source=made_from, steps=steps, notes=notes, unreachable=found.unreachable), found


def apply(
    plan: Plan,
    sessions: Mapping[str, Session],
    listener: Listener,
    options: RunOptions,
    stop: threading.Event | None = None,
) -> RunResult:
    """Do what the plan says; what came of each step is a value, nothing raises for a robot that fails."""
    return run_plan(plan, sessions, listener, options, stop)


def playbooks() -> dict[str, str]:
    """Return the playbooks that ship with srprov: file name -> text."""
    return {path.name: path.read_text(encoding="utf-8") for path in sorted(data.playbooks_folder().glob("*.yml"))}


def _images(containers: Mapping[str, ContainerDefinition]) -> tuple[dict[str, ImagePlan], dict[str, str]]:
    references = {key: one.image for key, one in containers.items() if one.image}
    if len(references) == len(containers):
        return {}, references
    from srprov import disk
    from srprov.images.tag import plan_image

    built = {key: plan_image(one, disk.listing, disk.read) for key, one in containers.items() if not one.image}
    return built, references


def _notes(placed: Assignment) -> tuple[str, ...]:
    stay = [f"{service} stays on {placed.placed[service]}, which cannot be reached" for service in placed.frozen]
    return tuple(stay)
