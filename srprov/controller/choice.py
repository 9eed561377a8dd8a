"""What is left to decide after the first look at the robots: perhaps nothing.

Takes definitions and a snapshot; gives a `Choice`. Pure. Only what is not there yet makes a difference to how an engine
is, and only a real choice needs the traffic of this moment; so what is to be decided says how closely to look.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec
from msgspec.structs import replace

from srprov.assignment import problem, solve
from srprov.assignment.model import Assignment, Problem
from srprov.controller.data import DataNow, data_now, held_fast
from srprov.controller.ownership import absent, previous_robots
from srprov.controller.platforms import with_platforms
from srprov.controller.readiness import of_others
from srprov.controller.request import PlanRequest
from srprov.definitions.expand import expand, nowhere
from srprov.definitions.model import Definitions, Experiment, Inventory
from srprov.definitions.pins import unknown_pins
from srprov.errors import DefinitionError, SrprovError
from srprov.facts.gather import Detail
from srprov.facts.model import Snapshot, TakenPort
from srprov.untrusted import decimal, integer, mapping, mappings, string, string_map, text


class Choice(msgspec.Struct, frozen=True, kw_only=True):
    """An experiment with every instance, and what of it is to be placed."""

    experiment: Experiment
    """With replicas and `per_robot` as services of their own, for the robots that were found."""
    data: DataNow
    previous: Mapping[str, str]
    """Service -> the robot it runs on now."""
    problem: Problem
    free: bool
    """Running services may move."""
    new: frozenset[str]
    """Services that are new, whose container is gone, or that cannot stay."""

    @property
    def detail(self) -> Detail:
        """How closely robots must be looked at to decide it well."""
        pinned = [name for name in self.new if self.experiment.services[name].robot]
        if self.free or len(pinned) < len(self.new):
            return Detail.TRAFFIC
        return Detail.ENGINE if self.new else Detail.BASIC


class Decided(msgspec.Struct, frozen=True, kw_only=True):
    """What else than files and facts led to a placement, read from a record."""

    previous: Mapping[str, str]
    home: Mapping[str, str]
    taken: Mapping[str, tuple[TakenPort, ...]]


def decided(choice: Choice, snapshot: Snapshot, instance: str, request: PlanRequest) -> dict[str, Any]:
    """Return it for a record, with what the user asked for."""
    return {
        "instance": instance,
        "previous": choice.previous,
        "home": choice.data.home,
        "taken": of_others(snapshot, instance, choice.experiment, choice.previous),
        "reassign": request.reassign,
        "reassign_unreachable": request.reassign_unreachable,
        "history": request.history,
        "data": request.data,
    }


def read_decided(value: object, request: PlanRequest) -> tuple[Decided, PlanRequest]:
    """Return what a record says of a decision, and the request with what was asked for then."""
    found = mapping(value)
    taken = {
        string(robot): tuple(
            TakenPort(
                address=string(one.get("address")), port=integer(one.get("port"), high=65535),
                protocol=string(one.get("protocol")), by=text(one.get("by")), instance=string(one.get("instance")),
            )
            for one in mappings(ports)
        )
        for robot, ports in mapping(found.get("taken")).items()
    }  # fmt: skip
    history = tuple(
        {string(robot): decimal(cost, low=0.0, high=1e9, default=0.0) for robot, cost in one.items()}
        for one in mappings(found.get("history"))
    )
    asked = replace(
        request,
        instance=string(found.get("instance")),
        reassign=found.get("reassign") is True,
        reassign_unreachable=found.get("reassign_unreachable") is True,
        history=history,
        data=string(found.get("data")),
    )
    return Decided(previous=string_map(found.get("previous")), home=string_map(found.get("home")), taken=taken), asked


def choice_of(
    definitions: Definitions, inventory: Inventory, snapshot: Snapshot, instance: str, request: PlanRequest,
    before: Decided | None = None,
) -> Choice:  # fmt: skip
    """Return what is to be decided, as far as this snapshot tells, or as a record has it of `before`.

    Raises:
        UsageError: Two instances would have one name, or relations contradict each other.
    """
    previous = before.previous if before else {**request.placed, **previous_robots(snapshot, instance)}
    experiment = with_platforms(_with_instances(definitions.experiment, snapshot, previous), definitions)
    data = data_now(experiment, snapshot, instance, previous, request)
    data = replace(data, home=before.home) if before else data
    if not request.data:
        experiment = held_fast(experiment, data.home, snapshot)
    return Choice(
        experiment=experiment,
        data=data,
        previous=previous,
        problem=problem.build(
            experiment,
            definitions.containers,
            snapshot,
            {**previous, **data.home},
            slots={name: host.slots for name, host in inventory.hosts.items() if host.slots is not None},
            reassign=request.reassign,
            reassign_unreachable=request.reassign_unreachable,
            history=request.history,
            taken=before.taken if before else of_others(snapshot, instance, experiment, previous),
        ),
        free=request.reassign or request.reassign_unreachable or not experiment.placement.sticky,
        new=frozenset(absent(snapshot, instance, previous, experiment.services)),
    )


def checked_choice(
    definitions: Definitions, inventory: Inventory, snapshot: Snapshot, request: PlanRequest,
    before: Decided | None = None,
) -> Choice:  # fmt: skip
    """Return the choice for who wants to know the assignment alone.

    Raises:
        DefinitionError: The files ask for robots that are not in the inventory.
        UsageError: As `choice_of`.
    """
    if unknown := unknown_pins(definitions.experiment, inventory):
        raise DefinitionError(unknown)
    instance = request.instance or definitions.experiment.name
    return choice_of(definitions, inventory, snapshot, instance, request, before)


def idle_notes(definitions: Definitions, experiment: Experiment, snapshot: Snapshot) -> tuple[str, ...]:
    """Return a note for each service that no robot matched; `experiment` has every instance."""
    return nowhere(definitions.experiment, experiment.services.values(), away=bool(snapshot.unreachable))


def settled(choice: Choice, seconds: float | None) -> tuple[Assignment | None, Choice]:
    """Return the assignment that leaves everything where it is, or None and the choice with what cannot stay."""
    if choice.free or choice.new:
        return None, choice
    try:
        placed = solve.solve(choice.problem, seconds)
    except SrprovError:  # to be seen again, with all that there is to know; then it is raised
        return None, replace(choice, new=frozenset(choice.experiment.services))
    moved = frozenset(name for name, robot in choice.previous.items() if placed.placed.get(name, robot) != robot)
    return (None, replace(choice, new=moved)) if moved else (placed, choice)


def _with_instances(experiment: Experiment, snapshot: Snapshot, previous: Mapping[str, str]) -> Experiment:
    away = {service: robot for service, robot in previous.items() if robot in snapshot.unreachable}
    return expand(experiment, {robot: facts.tags for robot, facts in snapshot.facts.items()}, away)
