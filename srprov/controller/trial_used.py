"""What was measured of an attempt's robots and containers, for its row. Pure."""

from __future__ import annotations

from collections.abc import Mapping

from srprov.controller.trial_plan import TrialPlan
from srprov.execution.trial_robots import TrialRobots
from srprov.trials import cgroup, hosts
from srprov.trials.clock import Offset
from srprov.trials.row import clocks as measured


def used(plan: TrialPlan, robots: TrialRobots) -> dict[str, object]:
    """Return what stands in an attempt's row of clocks, and for each robot and each service."""
    clocks: Mapping[str, Offset | None] = robots.measured[0] if robots.measured else {}
    facts = plan.base.snapshot.facts if plan.base.snapshot is not None else {}
    overlay = [one for one in plan.base.desired if one.module == "vxlan"]
    of_hosts = []
    for host, readings in sorted(robots.totals.hosts.items()):
        outer = facts[host].underlay_link if host in facts else ""
        own = [one.name for one in overlay if one.host == host]
        after = readings[-1] if readings[1:] else None
        of_hosts.append({"robot": host, **hosts.difference(readings[0], after, outer, own)})
    of_containers = []
    found = robots.totals.used()
    for service, one in sorted(robots.by_service.items()):
        offset = clocks.get(one.host)
        shown = cgroup.row(found.get(service, cgroup.Used()), offset.offset_s if offset else None)
        of_containers.append({"robot": one.host, "service": service, **shown})
    return {"clocks": _clocks(robots), "hosts": of_hosts, "containers": of_containers}


def _clocks(robots: TrialRobots) -> list[dict[str, object]]:
    """Return the rows of clocks, with what keeps each, which was read with it."""
    found = measured(robots.measured)
    for one in found:
        readings = robots.totals.hosts.get(str(one["robot"]), [])
        at = 0 if one["when"] == "before" else 1
        kept = readings[at].time_sync if at < len(readings) else None
        bound = kept.bound_s if kept else None
        one |= {
            "kept_by": kept.daemon if kept else None,
            "synchronised": kept.synchronised if kept else None,
            "sync_bound_ms": None if bound is None else 1000 * bound,
        }
    return found
