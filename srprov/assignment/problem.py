"""From definitions and facts to a Problem: what must be placed, where it could run, and why not elsewhere.

Takes the experiment (replicas and `per_robot` expanded), its CDFs, all robots as they are and where services run now;
gives the values the solver works on. Pure. `--limit` and `--exclude` filter what is changed, never what is decided, so
they do not appear here.

Source: the paper's matrices A, H and C; contraction of `same_robot` groups: docs/assignment.md.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType

from msgspec.structs import replace

from srprov.assignment import capability, ports
from srprov.assignment.cost import Load, at_slot, load
from srprov.assignment.model import Fairness, LazyMapping, Problem, ServiceGroup
from srprov.assignment.requirements import UnmetRequirement, missing, pinned_elsewhere
from srprov.codes import Code
from srprov.definitions.containermodel import ContainerDefinition
from srprov.definitions.model import Experiment
from srprov.errors import UsageError
from srprov.facts.model import Snapshot, TakenPort

_NOTHING: Mapping[str, Sequence[TakenPort]] = MappingProxyType({})


def build(
    experiment: Experiment, containers: Mapping[str, ContainerDefinition], snapshot: Snapshot,
    previous: Mapping[str, str], *, slots: Mapping[str, int] | None = None, reassign: bool = False,
    reassign_unreachable: bool = False, history: Sequence[Mapping[str, float]] = (),
    taken: Mapping[str, Sequence[TakenPort]] = _NOTHING,
) -> Problem:  # fmt: skip
    """Return the assignment problem of an experiment.

    `containers` has CDFs by the key of `Service.cdf`; `previous`, where services run now, by labels and for robots out
    of reach by the placement record; `slots`, those of `srprov_slots`; `history`, what earlier runs allocated; `taken`,
    the ports that others have. `reassign` lets services move; `reassign_unreachable` those out of reach.

    Raises:
        UsageError: A kernel bound that cannot be read, relations that contradict each other, or too many of them.
    """
    services = {name: experiment.services[name] for name in sorted(experiment.services)}
    platforms = {name: containers[one.cdf].platforms for name, one in services.items() if one.cdf}
    before = {name: previous[name] for name in services if name in previous}
    fixed = {name: service.robot for name, service in services.items() if service.per_robot is not None}
    groups = tuple(_contract((name for name in services if name not in fixed), experiment.same_robot))
    _check_anti_affinity(groups, experiment.different_robot)
    frozen = {} if reassign_unreachable else _freeze(groups, before, snapshot.unreachable)
    away = tuple(frozen.values())  # what is fixed takes no slot
    frozen |= {name: robot for name, robot in fixed.items() if robot in snapshot.unreachable}
    total = {robot: (slots or {}).get(robot, experiment.placement.slots_per_robot) for robot in sorted(snapshot.facts)}
    free = _free_slots(total, away, len(groups))
    made = Problem(
        services=services,
        nodes=tuple(group for group in groups if not frozen.keys() & set(group)),
        robots=tuple(sorted({*snapshot.facts, *snapshot.unreachable})),
        slots=free,
        loads=_loads(experiment, snapshot, free, total),
        capable=capability.matrix(services, platforms, [snapshot.facts[robot] for robot in free]),
        misses={},
        pools=experiment.pools,
        anti_affinity=experiment.different_robot,
        weights=experiment.weights,
        previous=before,
        frozen=frozen,
        fixed={name: robot for name, robot in sorted(fixed.items()) if name not in frozen},
        sticky=experiment.placement.sticky and not reassign,
        fairness=_fairness(experiment.placement.fairness, history),
        facts=snapshot.facts,
    )
    return _with_ports(made, groups, platforms, snapshot.unreachable, taken)


def _with_ports(
    problem: Problem, groups: Sequence[ServiceGroup], platforms: Mapping[str, Sequence[str]],
    unreachable: Mapping[str, str], taken: Mapping[str, Sequence[TakenPort]],
) -> Problem:  # fmt: skip
    """Return the problem with the robots' ports as something that only one service of a robot can have."""
    held = ports.holders(problem.services, {**problem.fixed, **problem.frozen}, taken)
    # what is fixed has its ports by `held`
    shared = ports.exclusive({name: one for name, one in problem.services.items() if name not in problem.fixed})
    for names, one, other in _together(groups, shared):
        message = f"'{one}' and '{other}' must share a robot, and both publish {shared[names]}"
        hint = "give one of them another port, or take it out of same_robot"
        raise UsageError(message, hint=hint, code=Code.CONTRADICTION)
    exclusive = replace(
        problem,
        anti_affinity=tuple(dict.fromkeys((*problem.anti_affinity, *shared))),
        ports=shared,
        capable=ports.without_taken(problem.capable, problem.services, tuple(problem.loads), held),
    )
    return _with_misses(exclusive, groups, platforms, unreachable, held)


def _with_misses(
    problem: Problem, groups: Sequence[ServiceGroup], platforms: Mapping[str, Sequence[str]],
    unreachable: Mapping[str, str], held: ports.Holders,
) -> Problem:  # fmt: skip
    """Return the problem with what robots lack, worked out when it is asked for: few answers need all of it."""
    names = tuple(problem.services)
    own = LazyMapping(names, lambda name: _own(problem, name, platforms.get(name, ()), unreachable, held))
    mates = {name: group for group in groups for name in group}
    return replace(problem, misses=LazyMapping(names, lambda name: _with_group(own, name, mates.get(name, (name,)))))


def _contract(services: Iterable[str], same_robot: Sequence[Sequence[str]]) -> Iterator[ServiceGroup]:
    """Return each service in exactly one node; groups that share a service are one node."""
    node_of = {name: frozenset({name}) for name in services}
    for group in same_robot:
        merged = frozenset().union(*(node_of[name] for name in group if name in node_of))
        node_of.update(dict.fromkeys(merged, merged))
    return iter(sorted({tuple(sorted(node)) for node in node_of.values()}))


def _check_anti_affinity(groups: Sequence[ServiceGroup], anti_affinity: Sequence[ServiceGroup]) -> None:
    for _, one, other in _together(groups, anti_affinity):
        message = f"'{one}' and '{other}' must share a robot, and must not"
        hint = "look at same_robot and different_robot under 'relations'"
        raise UsageError(message, hint=hint, code=Code.CONTRADICTION)


def _together(groups: Iterable[ServiceGroup], apart: Iterable[ServiceGroup]) -> Iterator[tuple[ServiceGroup, str, str]]:
    """Return those of `apart` of which a group has more than one service, with two that it has."""
    for group in (one for one in groups if len(one) > 1):
        for names in apart:
            if len(both := sorted(set(group) & set(names))) > 1:
                yield names, both[0], both[1]


def _freeze(
    groups: Sequence[ServiceGroup], before: Mapping[str, str], unreachable: Mapping[str, str]
) -> dict[str, str]:
    """Return the services that stay where they are because a robot of their group cannot be reached.

    Nothing of such a group moves, since it may still run there; what does not run yet joins the robot out of reach.
    """
    frozen: dict[str, str] = {}
    for group in groups:
        away = [before[name] for name in group if before.get(name) in unreachable]
        frozen.update((name, before.get(name, away[0])) for name in group if away)
    return frozen


def _free_slots(total: Mapping[str, int], frozen: Sequence[str], nodes: int) -> dict[str, int]:
    """Return the free slots per reachable robot, no more than could be used; what is frozen there takes its own."""
    taken = Counter(frozen)
    return {robot: max(0, min(nodes, count - taken[robot])) for robot, count in total.items()}


def _loads(
    experiment: Experiment, snapshot: Snapshot, free: Mapping[str, int], total: Mapping[str, int]
) -> dict[str, tuple[Load, ...]]:
    reference = experiment.placement.bandwidth_reference_mbit
    return {robot: _per_slot(load(snapshot.facts[robot], reference), free[robot], total[robot]) for robot in free}


def _per_slot(idle: Load, free: int, slots: int) -> tuple[Load, ...]:
    """Return the load in every free slot; at least the first, since the cost matrix shows what that would cost."""
    return tuple(at_slot(idle, slot, slots) for slot in range(max(1, free)))


def _fairness(weight: float, history: Sequence[Mapping[str, float]]) -> Fairness:
    carried: dict[str, float] = {}
    for run in history:
        for robot, cost in run.items():
            carried[robot] = carried.get(robot, 0.0) + cost
    return Fairness(weight=weight, carried=dict(sorted(carried.items())), runs=len(history))


def _own(
    problem: Problem, name: str, platforms: Sequence[str], unreachable: Mapping[str, str], held: ports.Holders
) -> dict[str, tuple[UnmetRequirement, ...]]:
    """Return robot -> what it lacks for a service alone; nothing for a robot that lacks nothing."""
    service, able = problem.services[name], problem.capable[name]
    lacks = {
        robot: (*missing(service, platforms, problem.facts[robot]), *ports.missing_ports(service, robot, held))
        for bit, robot in enumerate(problem.loads)
        if not able >> bit & 1
    }
    # a pin is known without asking the robot
    lacks |= {
        robot: (_out_of_reach(robot, reason), *pinned_elsewhere(service, robot))
        for robot, reason in unreachable.items()
    }
    return dict(sorted(lacks.items()))


def _out_of_reach(robot: str, reason: str) -> UnmetRequirement:
    return UnmetRequirement(f"unreachable: {reason}" if reason else "unreachable", f"make {robot} reachable")


def _with_group(
    own: Mapping[str, Mapping[str, tuple[UnmetRequirement, ...]]], name: str, group: ServiceGroup
) -> dict[str, tuple[UnmetRequirement, ...]]:
    """Add to a service what robots lack for those that must share its robot; a robot serves all or none."""
    lacks = dict(own[name])
    for other in group:
        for robot, missed in own[other].items() if other != name else ():
            if robot not in own[name]:
                shared = tuple(
                    UnmetRequirement(f"must run with '{other}': {miss.text}", miss.remedy) for miss in missed
                )
                lacks[robot] = lacks.get(robot, ()) + shared
    return dict(sorted(lacks.items()))
