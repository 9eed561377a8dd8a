"""The values of this room: Problem goes into the solver, Assignment comes out.

Touches nothing. Everything is keyed by the names of services and robots and walked in name order, so that equal inputs
give one answer whatever the order of files and hosts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from srprov.assignment.cost import CostTerms, Load, terms
from srprov.definitions.model import Weights

Node = tuple[str, ...]
"""Services that must share a robot, in name order; most often just one."""


@dataclass(frozen=True, order=True, slots=True)
class Miss:
    """One thing that a robot lacks for a service: what is required and what the robot has, and what would help."""

    text: str
    remedy: str


@dataclass(frozen=True, kw_only=True, slots=True)
class Problem:
    """Who could run what, at which cost. The paper's matrices A (`cost`), H (`misses`) and C (`slots`)."""

    nodes: tuple[Node, ...]
    """What must be decided: every service once, except those that are frozen."""
    robots: tuple[str, ...]
    """All robots by name, also those that cannot be reached."""
    slots: Mapping[str, int]
    """Free places per reachable robot, at most one per node; what `frozen` holds there is taken off."""
    alphas: Mapping[str, float]
    """Pre-defined cost per service."""
    loads: Mapping[str, tuple[Load, ...]]
    """Reachable robot -> the loads in each of its slots."""
    misses: Mapping[str, Mapping[str, tuple[Miss, ...]]]
    """Service -> robot -> what it lacks; a robot that lacks nothing is not listed."""
    weights: Weights = field(default_factory=Weights)
    previous: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    """Service -> the robot it runs on now."""
    frozen: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    """Service -> its robot; not decided here, because that robot (or one of its group) cannot be reached."""
    sticky: bool = True
    """Moving nothing comes before a lower cost."""

    def cost(self, service: str, robot: str, slot: int = 0) -> CostTerms:
        """Give the terms of one service in one slot of a reachable robot."""
        return terms(self.alphas[service], self.loads[robot][slot], self.weights)

    def node_cost(self, node: Node, robot: str, slot: int = 0) -> float:
        """Give what all services of a node cost together."""
        return sum(self.cost(service, robot, slot).total for service in node)

    def eligible(self, node: Node) -> tuple[str, ...]:
        """Give the robots that lack nothing for any service of the node, in name order."""
        return tuple(r for r in self.robots if r in self.loads and not any(r in self.misses[s] for s in node))

    def moved(self, node: Node, robot: str) -> int:
        """Count the services of a node that run on some other robot now."""
        return sum(self.previous.get(service, robot) != robot for service in node)


@dataclass(frozen=True, kw_only=True, slots=True)
class Move:
    """A service that leaves the robot it runs on."""

    service: str
    source: str
    target: str


@dataclass(frozen=True, kw_only=True, slots=True)
class RunnerUp:
    """The best other robot for a service and those that must share its robot."""

    robot: str
    cost: float
    difference: float
    """Against what they cost now; negative when it would be cheaper, which only others or stickiness can prevent."""
    full: bool
    """Others have all of its slots."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Assignment:
    """Who runs what, what it costs and why."""

    placed: Mapping[str, str]
    """Service -> robot, frozen ones included."""
    cost: float
    """Sum over all services on robots that could be reached; what a robot out of reach would cost is not known."""
    terms: Mapping[str, CostTerms]
    optimal: bool
    """No placement costs less (proved; compared in the solver's unit, a millionth). Stickiness may make it False."""
    least: float
    """What the cheapest placement costs: `--reassign` would reach it."""
    moves: tuple[Move, ...] = ()
    frozen: tuple[str, ...] = ()
    """Services that stay on a robot that cannot be reached, and those that wait for it with them."""
    matrix: Mapping[str, Mapping[str, float | None]]
    """Service -> robot -> cost in the robot's first slot, None where it cannot run."""
    why_not: Mapping[str, Mapping[str, str]]
    """Service -> robot -> reason, for every None of `matrix`."""
    runner_up: Mapping[str, RunnerUp]
    """Only for services that some other robot could run."""
    jain: float
    """Jain's index over the cost per reachable robot."""
    notes: tuple[str, ...] = ()
    """What had to be assumed of which robots."""
