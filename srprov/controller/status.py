"""What of an instance runs where. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from srprov.errors import UsageError
from srprov.facts.model import Snapshot
from srprov.modules import RUNNING


def status_rows(snapshot: Snapshot, instance: str) -> list[dict[str, Any]]:
    """Return one row per container, and one per service that is known to be on a robot that cannot be reached.

    Args:
        snapshot: The robots as they are.
        instance: The instance's id; empty: all of them.
    """
    rows = []
    for host, items in snapshot.observed.items():
        for item in items:
            if item.module in RUNNING and instance in ("", item.instance):
                rows.append(_row(item.instance, item.service, host, item.state))
    for name, record in snapshot.placements.items():
        services = record.get("services")
        if instance in ("", name) and isinstance(services, Mapping):
            for service, entry in services.items():
                robot = entry.get("robot", "") if isinstance(entry, Mapping) else ""
                if isinstance(robot, str) and robot in snapshot.unreachable:
                    rows.append(_row(name, str(service), str(robot), {"status": "unreachable", "addresses": {}}))
    return sorted(rows, key=lambda row: (row["instance"], row["service"], row["robot"]))


def _row(instance: str, service: str, host: str, state: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "instance": instance,
        "service": service,
        "robot": host,
        "state": state.get("status", ""),
        "health": state.get("health", ""),
        "address": next((address for address in state["addresses"].values() if address), ""),
        "image": state.get("image", ""),
        "container": state.get("id", ""),
    }


def containers_of(snapshot: Snapshot, instance: str, services: Sequence[str]) -> list[tuple[str, str, str]]:
    """Return (service, robot, container's name) of the services that are named, or of all.

    Raises:
        UsageError: A service has no container on any robot, and no robot is out of reach.
    """
    there = sorted(
        (item.service, host, item.name)
        for host, items in snapshot.observed.items()
        for item in items
        if item.module in RUNNING and item.instance == instance
    )
    known = [service for service, _, _ in there]
    unknown = sorted(set(services) - set(known))
    if snapshot.unreachable and (unknown or not there):
        return [one for one in there if one[0] in services]  # what is missing may be on a robot that is away
    if unknown:
        raise UsageError(
            f"no container of {', '.join(unknown)} on these robots", hint=f"there are: {', '.join(known) or 'none'}"
        )
    if not there:
        raise UsageError(f"nothing of {instance} on these robots", hint="srprov apply starts it")
    return [one for one in there if not services or one[0] in services]
