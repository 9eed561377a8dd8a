"""The values of this room: Problem goes into the solver, Assignment comes out.

Touches nothing. Everything is keyed by the names of services and robots and walked in name order, so that equal inputs
give one answer whatever the order of files and hosts. What is said for every pair of service and robot is worked out
only when somebody asks for it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import reduce
from operator import and_
from types import MappingProxyType
from typing import TypeVar

import msgspec

from srprov.assignment.cost import CostTerms, Load, terms
from srprov.assignment.requirements import UnmetRequirement
from srprov.definitions.model import Pool, Service, Weights
from srprov.facts.model import HostFacts

ServiceGroup = tuple[str, ...]
"""Services that must share a robot, in name order; most often just one."""
Choice = tuple[ServiceGroup, str, int]
"""What takes one slot (services in name order: a node, or nodes whose pool runs together), its robot, the slot."""

SCALE = 1_000_000
"""Units per 1.0 of cost: costs are compared to a millionth."""

_V = TypeVar("_V")


@dataclass(frozen=True, slots=True, eq=False)
class LazyMapping(Mapping[str, _V]):
    """A mapping that works out a value when it is asked for; what is asked for once is kept."""

    names: tuple[str, ...]
    make: Callable[[str], _V]
    made: dict[str, _V] = field(default_factory=dict)

    def __getitem__(self, name: str) -> _V:
        if name not in self.made:
            if name not in self.names:
                raise KeyError(name)
            self.made[name] = self.make(name)
        return self.made[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)

    def __repr__(self) -> str:
        return repr(dict(self))


class Fairness(msgspec.Struct, frozen=True, kw_only=True):
    """How much evenness counts, and what robots have carried before."""

    weight: float = 0.0
    """0: least cost; 1: most even."""
    carried: Mapping[str, float] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Robot -> the sum of what was allocated to it in earlier runs."""
    runs: int = 0


class Problem(msgspec.Struct, frozen=True, kw_only=True):
    """Who could run what, at which cost. The paper's matrices A (`cost`), H (`misses`) and C (`slots`)."""

    services: Mapping[str, Service]
    """All of them, in name order."""
    nodes: tuple[ServiceGroup, ...]
    """What must be decided: every service once, except those that are fixed or frozen."""
    robots: tuple[str, ...]
    """All robots by name, also those that cannot be reached."""
    slots: Mapping[str, int]
    """Free places per reachable robot, at most one per node; what `frozen` holds there is taken off."""
    loads: Mapping[str, tuple[Load, ...]]
    """Reachable robot -> the loads in each of its slots, at least in the first."""
    capable: Mapping[str, int]
    """Service -> its row: bit i is set where the i-th of `loads` lacks nothing for the service itself."""
    misses: Mapping[str, Mapping[str, tuple[UnmetRequirement, ...]]]
    """Service -> robot -> what it lacks; a robot that lacks nothing is not listed."""
    pools: tuple[Pool, ...] = ()
    anti_affinity: tuple[tuple[str, ...], ...] = ()
    """Groups of services of which a robot runs one at most."""
    ports: Mapping[ServiceGroup, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Those of `anti_affinity` that have a port of their robot in common -> that port, such as `8080/tcp`."""
    weights: Weights = msgspec.field(default_factory=Weights)
    previous: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Service -> the robot it runs on now."""
    frozen: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Service -> its robot; not decided here, because that robot (or one of its group) cannot be reached."""
    fixed: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Service that is on each matching robot -> this one's robot; takes no slot."""
    sticky: bool = True
    """Moving nothing comes before a lower cost."""
    fairness: Fairness = msgspec.field(default_factory=Fairness)
    facts: Mapping[str, HostFacts] = msgspec.field(default_factory=lambda: MappingProxyType({}))

    @property
    def kept_apart(self) -> tuple[tuple[str, ...], ...]:
        """Return `anti_affinity` as far as it matters: robots of one slot keep everything apart but pools."""
        crowded = self.pools or max(self.slots.values(), default=0) > 1
        return self.anti_affinity if crowded else ()

    @property
    def alphas(self) -> dict[str, float]:
        """Return the pre-defined cost per service."""
        return {name: service.cost for name, service in self.services.items()}

    def cost(self, service: str, robot: str, slot: int = 0, discount: float = 1.0) -> CostTerms:
        """Return the terms of one service in one slot of a reachable robot."""
        return terms(self.services[service].cost * discount, self.loads[robot][slot], self.weights)

    def eligible(self, node: ServiceGroup) -> tuple[str, ...]:
        """Return the reachable robots that lack nothing for any service of the node, in name order."""
        able = self.able(node)
        return tuple(robot for bit, robot in enumerate(self.loads) if able >> bit & 1)

    def able(self, services: Iterable[str]) -> int:
        """Return the row of services that share a robot: bit i is set if the i-th of `loads` lacks nothing for any."""
        return reduce(and_, (self.capable[name] for name in services), (1 << len(self.loads)) - 1)

    def moved(self, node: ServiceGroup, robot: str) -> int:
        """Count the services of a node that run on some other robot now."""
        return sum(self.previous.get(service, robot) != robot for service in node)


class Decision(msgspec.Struct, frozen=True, kw_only=True):
    """What a solver chose, and what it proved; an Assignment says the same to users."""

    chosen: tuple[Choice, ...]
    """In the order of nodes, then of bundles."""
    pools: tuple[Pool, ...] = ()
    """Those that run together."""
    spared: int = 0
    """How much less the cheapest placement costs, in millionths."""
    gap: int = 0
    """How much less a better placement might cost where a time limit ended the search, in millionths."""


class Move(msgspec.Struct, frozen=True, kw_only=True):
    """A service that leaves the robot it runs on."""

    service: str
    source: str
    target: str


class RunnerUp(msgspec.Struct, frozen=True, kw_only=True):
    """The best other robot for a service and those that share its slot."""

    robot: str
    cost: float
    difference: float
    """Against what they cost now; negative when it would be cheaper, which only others or stickiness can prevent."""
    full: bool
    """Others have all of its slots."""


class Assignment(msgspec.Struct, frozen=True, kw_only=True):
    """Who runs what, what it costs and why."""

    placed: Mapping[str, str]
    """Service -> robot, frozen and fixed ones included."""
    cost: float
    """Sum over all services on robots that could be reached; what a robot out of reach would cost is not known."""
    terms: Mapping[str, CostTerms]
    """Service -> its share, a pool's discount taken off."""
    optimal: bool
    """No placement costs less (proved; compared in the solver's unit, a millionth). Stickiness may make it False."""
    least: float
    """What the cheapest placement costs: `--reassign` would reach it."""
    gap: float = 0.0
    """How much less a better placement might cost, where a time limit ended the search; else 0."""
    moves: tuple[Move, ...] = ()
    frozen: tuple[str, ...] = ()
    """Services that stay on a robot that cannot be reached, and those that wait for it with them."""
    pools: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Pool -> `together` or `anti_affinity`."""
    matrix: Mapping[str, Mapping[str, float | None]]
    """Service -> robot -> cost in the robot's first slot, alone, None where it cannot run."""
    why_not: Mapping[str, Mapping[str, str]]
    """Service -> robot -> reason, for every None of `matrix`."""
    runner_up: Mapping[str, RunnerUp]
    """Only for services that some other robot could run."""
    jain: float
    """Jain's index over the cost per reachable robot, summed with what they carried in earlier runs."""
    notes: tuple[str, ...] = ()
    """What had to be assumed of which robots."""
