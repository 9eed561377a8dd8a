"""What a plan relies on, per robot: if any of it moved, the plan is stale. Pure.

In: the engine and its API version, the facts that eligibility was judged by, addresses and MTU, and the state of
the instance's resources and of those that the plan names. Out: load, free memory, clock, uptime, texts that change by
the minute, and hashes of secrets, which would help to guess them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from srprov.facts.model import HostFacts, Snapshot
from srprov.planning.plan import Plan
from srprov.resource import Observed
from srprov.secret import Hidden

_PASSING = ("status", "health", "labels", "id")
"""Keys of a state that say nothing of whether it is the same: `Up 3 minutes`, a health that settles, labels, an id."""


def fingerprints(plan: Plan, snapshot: Snapshot) -> dict[str, dict[str, Any]]:
    """Return the fingerprint of every robot that the plan places a service on or has a step for."""
    hosts = {*plan.assignment.values(), *(step.host for step in plan.steps)} & set(snapshot.facts)
    return {host: fingerprint(plan, host, snapshot.facts[host], snapshot.observed[host]) for host in sorted(hosts)}


def fingerprint(plan: Plan, host: str, facts: HostFacts, observed: Iterable[Observed]) -> dict[str, Any]:
    """Return one robot's fingerprint: JSON values only."""
    named = {(step.module, step.name) for step in plan.steps if step.host == host}
    ours = [e for e in observed if e.instance == plan.instance or (e.module, e.name) in named]
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
