"""From definitions and facts to a Problem: what must be placed, where it could run, and why not elsewhere.

Takes the experiment, its CDFs, all robots as they are and where services run now; gives the values the solver works on.
Pure. `--limit` and `--exclude` filter what is changed, never what is decided, so they do not appear here.

Source: the paper's matrices A, H and C; contraction of `same_robot` groups: docs/assignment.md.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from srprov.assignment.cost import Load, at_slot, load
from srprov.assignment.model import Miss, Node, Problem
from srprov.assignment.requirements import missing
from srprov.definitions.model import ContainerDefinition, Experiment, Service
from srprov.facts.model import Found

Misses = dict[str, dict[str, tuple[Miss, ...]]]


def build(
    experiment: Experiment,
    containers: Mapping[str, ContainerDefinition],
    found: Found,
    previous: Mapping[str, str],
    *,
    slots: Mapping[str, int] | None = None,
    reassign: bool = False,
    reassign_unreachable: bool = False,
) -> Problem:
    """Give the assignment problem of an experiment.

    Args:
        experiment: What must run.
        containers: CDFs by the key that `Service.cdf` holds.
        found: All robots of the inventory, reachable or not.
        previous: Service -> the robot it runs on now: by labels, and by the placement record for robots out of reach.
        slots: Robots whose inventory says `srprov_slots`; the others have `placement.slots_per_robot`.
        reassign: Let running services move when that is cheaper (`--reassign`).
        reassign_unreachable: Place services of robots that cannot be reached elsewhere (`--unreachable=reassign`).

    Raises:
        UsageError: A kernel bound that cannot be read.
    """
    services = {name: experiment.services[name] for name in sorted(experiment.services)}
    before = {name: previous[name] for name in services if name in previous}
    groups = tuple(_contract(services, experiment.same_robot))
    frozen = {} if reassign_unreachable else _freeze(groups, before, found.unreachable)
    total = {robot: (slots or {}).get(robot, experiment.placement.slots_per_robot) for robot in sorted(found.facts)}
    free = _free_slots(total, tuple(frozen.values()), len(groups))
    reference = experiment.placement.bandwidth_reference_mbit
    return Problem(
        nodes=tuple(group for group in groups if not frozen.keys() & set(group)),
        robots=tuple(sorted({*found.facts, *found.unreachable})),
        slots=free,
        alphas={name: service.cost for name, service in services.items()},
        loads={robot: _per_slot(load(found.facts[robot], reference), free[robot], total[robot]) for robot in free},
        misses=_with_groups(groups, _own_misses(services, containers, found)),
        weights=experiment.weights,
        previous=before,
        frozen=frozen,
        sticky=experiment.placement.sticky and not reassign,
    )


def _contract(services: Iterable[str], same_robot: Sequence[Sequence[str]]) -> Iterator[Node]:
    """Give each service in exactly one node; groups that share a service are one node."""
    node_of = {name: frozenset({name}) for name in services}
    for group in same_robot:
        merged = frozenset().union(*(node_of[name] for name in group))
        node_of.update(dict.fromkeys(merged, merged))
    return iter(sorted({tuple(sorted(node)) for node in node_of.values()}))


def _freeze(groups: Sequence[Node], before: Mapping[str, str], unreachable: Mapping[str, str]) -> dict[str, str]:
    """Give the services that stay where they are because a robot of their group cannot be reached.

    Nothing of such a group moves, since it may still run there; what does not run yet joins the robot out of reach.
    """
    frozen: dict[str, str] = {}
    for group in groups:
        away = [before[name] for name in group if before.get(name) in unreachable]
        frozen.update((name, before.get(name, away[0])) for name in group if away)
    return frozen


def _free_slots(total: Mapping[str, int], frozen: Sequence[str], nodes: int) -> dict[str, int]:
    """Give the free slots per reachable robot, no more than could be used; what is frozen there takes its own."""
    return {robot: max(0, min(nodes, count - frozen.count(robot))) for robot, count in total.items()}


def _per_slot(idle: Load, free: int, slots: int) -> tuple[Load, ...]:
    """Give the load in every free slot; at least the first, since the cost matrix shows what that would cost."""
    return tuple(at_slot(idle, slot, slots) for slot in range(max(1, free)))


def _own_misses(services: Mapping[str, Service], containers: Mapping[str, ContainerDefinition], found: Found) -> Misses:
    """Give service -> robot -> what the robot lacks for that service alone; nothing for a robot that lacks nothing."""
    misses: Misses = {}
    for name, service in services.items():
        platforms = containers[service.cdf].platforms if service.cdf else ()
        lacks = {robot: missing(service, platforms, facts) for robot, facts in found.facts.items()}
        lacks |= {robot: (_out_of_reach(robot, reason),) for robot, reason in found.unreachable.items()}
        misses[name] = {robot: lacks[robot] for robot in sorted(lacks) if lacks[robot]}
    return misses


def _out_of_reach(robot: str, reason: str) -> Miss:
    return Miss(f"unreachable: {reason}" if reason else "unreachable", f"make {robot} reachable")


def _with_groups(groups: Sequence[Node], own: Misses) -> Misses:
    """Add to every service what robots lack for those that must share its robot; a robot serves all or none."""
    misses: Misses = {name: dict(robots) for name, robots in own.items()}
    for group in groups:
        for name in group:
            for other in group:
                for robot, lacks in own[other].items():
                    if other != name and robot not in own[name]:
                        shared = tuple(Miss(f"must run with '{other}': {miss.text}", miss.remedy) for miss in lacks)
                        misses[name][robot] = misses[name].get(robot, ()) + shared
        for name in group:
            misses[name] = dict(sorted(misses[name].items()))
    return dict(sorted(misses.items()))
