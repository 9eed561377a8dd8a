"""The instances that robots have something of, and who made them. Pure."""

from __future__ import annotations

from collections.abc import Collection

import msgspec

from srprov.facts.model import Snapshot
from srprov.modules import MODULES, RUNNING
from srprov.network.record import read_record


class Instance(msgspec.Struct, frozen=True, kw_only=True):
    """One instance, as robots in reach show it."""

    name: str
    sources: tuple[str, ...]
    """Who made it, by the labels of its containers and by placement records; empty where nothing says so."""
    robots: tuple[str, ...]
    containers: int
    volumes: int
    """Those that hold data."""


def instances_there(snapshot: Snapshot, among: Collection[str]) -> list[Instance]:
    """Return the instances of which one of the robots `among` has something, sorted; a robot may name any."""
    robots: dict[str, set[str]] = {}
    sources: dict[str, set[str]] = {}
    counts: dict[str, list[int]] = {}
    for robot, items in snapshot.observed.items():
        for item in items if robot in among else ():
            if not item.instance or MODULES[item.module].shared:
                continue
            robots.setdefault(item.instance, set()).add(robot)
            sources.setdefault(item.instance, set()).add(str(item.state.get("source") or ""))
            count = counts.setdefault(item.instance, [0, 0])
            count[0] += item.module in RUNNING
            count[1] += MODULES[item.module].keeps(item.state)
    for robot, held in snapshot.records.items():
        for name, record in held.items() if robot in among else ():
            robots.setdefault(name, set()).add(robot)
            known = read_record(record)
            sources.setdefault(name, set()).add(known.source if known else "")
    return [
        Instance(
            name=name,
            sources=tuple(sorted(sources[name] - {""})),
            robots=tuple(sorted(robots[name])),
            containers=counts.get(name, [0, 0])[0],
            volumes=counts.get(name, [0, 0])[1],
        )
        for name in sorted(robots)
    ]
