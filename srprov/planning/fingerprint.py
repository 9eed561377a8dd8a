"""What a plan relies on, per robot: if any of it moved, the plan is stale. Pure.

In: the engine and its API version, the facts that eligibility was judged by, addresses and MTU, and the state of
the instance's resources and of those that the plan names. Out: load, free memory, clock, uptime, texts that change by
the minute, and hashes of secrets, which would help to guess them.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Any

from srprov.facts.model import HostFacts, Snapshot
from srprov.planning.plan import Plan
from srprov.resource import Observed, Resource
from srprov.secret import Hidden

_PASSING = ("status", "health", "labels", "id")
"""Keys of a state that say nothing of whether it is the same: `Up 3 minutes`, a health that settles, labels, an id."""


def fingerprints(
    plan: Plan, snapshot: Snapshot, wanted: Iterable[Resource], hosts: Collection[str]
) -> dict[str, dict[str, Any]]:
    """Return the fingerprint of every robot of `hosts` that can be reached; `wanted` is all that the plan wants."""
    named: dict[str, set[tuple[str, str]]] = {}
    for host, module, name in [
        *((step.host, step.module, step.name) for step in plan.steps),
        *((want.host, want.module, want.name) for want in wanted),
    ]:
        named.setdefault(host, set()).add((module, name))
    return {
        host: _fingerprint(snapshot.facts[host], _ours(plan, snapshot.observed[host], named.get(host, ())))
        for host in sorted(set(hosts) & snapshot.facts.keys())
    }


def relied_on(plan: Plan) -> frozenset[str]:
    """Return the robots that the plan places a service on or has a step for."""
    return frozenset({*plan.assignment.values(), *(step.host for step in plan.steps)})


def _ours(plan: Plan, observed: Iterable[Observed], named: Collection[tuple[str, str]]) -> list[Observed]:
    return [one for one in observed if one.instance == plan.instance or (one.module, one.name) in named]


def _fingerprint(facts: HostFacts, ours: Iterable[Observed]) -> dict[str, Any]:
    """Return one robot's fingerprint: JSON values only."""
    return {
        "engine": {"version": facts.docker.version, "api": facts.docker.api_version} if facts.docker else None,
        "host": {
            "arch": facts.arch,
            "cpus": facts.cpus,
            "memory": facts.memory_total,
            "disk": facts.disk_total,
            "kernel": facts.kernel,
            "tags": list(facts.tags),
            "devices": list(facts.devices),
        },
        "underlay": {"address": facts.underlay_address, "mtu": facts.underlay_mtu},
        "resources": {f"{e.module}:{e.name}": lasting(e.state) for e in sorted(ours, key=lambda e: (e.module, e.name))},
    }


def lasting(state: Mapping[str, Any]) -> dict[str, Any]:
    """Return what of a found state does not change by itself, and may be written down."""
    return {key: value for key, value in sorted(state.items()) if key not in _PASSING and not isinstance(value, Hidden)}
