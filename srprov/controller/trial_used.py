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
    return {"clocks": measured(robots.measured), "hosts": of_hosts, "containers": of_containers}
