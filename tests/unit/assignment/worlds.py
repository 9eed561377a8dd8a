"""Small worlds to place services in: robots, services and experiments with only what a test is about."""

from __future__ import annotations

from collections.abc import Mapping

from srprov.assignment import problem, solve
from srprov.assignment.cost import CostTerms, at_slot, load, terms
from srprov.assignment.model import Assignment
from srprov.definitions.containermodel import Requirements
from srprov.definitions.model import Experiment, Placement, Service, Weights
from srprov.facts.model import Docker, HostFacts, Snapshot
from srprov.resource import Observed

GIB = 1 << 30
DOCKER = Docker(version="27.0.3", api_version="1.46")


def robot(name: str, **facts: object) -> HostFacts:
    """Return an idle robot that can run anything, with `facts` on top."""
    defaults: dict[str, object] = {
        "arch": "amd64",
        "cpus": 4,
        "memory_total": 8 * GIB,
        "memory_available": 8 * GIB,
        "disk_total": 32 * GIB,
        "kernel": "6.1.0-18-amd64",
        "docker": DOCKER,
        "speed_mbit": 1000.0,
    }
    return HostFacts(name=name, **(defaults | facts))


def service(name: str, **fields: object) -> Service:
    """Return a service; `tags` stands for `requires` with these tags."""
    if "tags" in fields:
        fields["requires"] = Requirements(tags=fields.pop("tags"))
    return Service(name=name, image="busybox", **fields)


def experiment(*services: Service, **fields: object) -> Experiment:
    """Return an experiment named `hello`."""
    by_name = {one.name: one for one in services}
    return Experiment(name="hello", file="/e/hello.edf", folder="/e", services=by_name, **fields)


def found(*robots: HostFacts, unreachable: Mapping[str, str] | None = None, **fields: object) -> Snapshot:
    """Return all robots as they are."""
    observed: Mapping[str, tuple[Observed, ...]] = fields.pop("observed", {})
    facts = {one.name: one for one in robots}
    return Snapshot(facts=facts, observed=observed, unreachable=unreachable or {}, **fields)


def assign(
    what: Experiment, where: Snapshot, previous: Mapping[str, str] | None = None, **options: object
) -> Assignment:
    """Build and solve in one go."""
    return solve.solve(problem.build(what, {}, where, previous or {}, **options))


def cost_terms(
    service: Service,
    facts: HostFacts,
    weights: Weights,
    placement: Placement,
    slot: int = 0,
    slots: int | None = None,
) -> CostTerms:
    """Return what `service` costs in a slot of a robot with `slots`, else the experiment's number."""
    idle = load(facts, placement.bandwidth_reference_mbit)
    return terms(service.cost, at_slot(idle, slot, slots or placement.slots_per_robot), weights)
