"""Data volumes as users want them listed: of whom, where, how large, how old.

Takes the robots as they are; asks them for sizes.
"""

from __future__ import annotations

import concurrent.futures
import datetime as dt
from collections.abc import Mapping, Sequence
from typing import Any

from srprov.controller.fleet import Fleet
from srprov.errors import TransportError
from srprov.facts.model import Snapshot
from srprov.modules import MODULES, RUNNING
from srprov.modules.volume import moment
from srprov.sizes import size_text
from srprov.untrusted import integer
from srprov.wire import Query, quote

COLUMNS = ("instance", "volume", "robot", "size", "age", "used by")
_DU_S = 30.0
_UNITS = (("d", 86400), ("h", 3600), ("min", 60))


def volume_rows(snapshot: Snapshot, instance: str, *, kept: bool = False) -> list[dict[str, Any]]:
    """Return a row per data volume, as `schemas/status.schema.json` has it, without sizes.

    Args:
        snapshot: The robots as they are.
        instance: The instance's id; empty: all of them.
        kept: Only those of instances that have no container on that robot.
    """
    rows = []
    for robot, items in snapshot.observed.items():
        busy = {item.instance for item in items if item.module in RUNNING}
        for item in items:
            if MODULES[item.module].holds_data and instance in ("", item.instance):
                row = {"instance": item.instance, "volume": item.name, "robot": robot, "bytes": None}
                rows.append({**row, "created": item.state["created"], "used": item.instance in busy})
    rows.sort(key=lambda row: (row["instance"], row["volume"], row["robot"]))
    return [row for row in rows if not (kept and row["used"])]


def with_sizes(rows: Sequence[Mapping[str, Any]], fleet: Fleet, snapshot: Snapshot) -> list[dict[str, Any]]:
    """Return the rows with sizes; one round trip to each robot that has some, all at once."""
    places = {
        (robot, item.name): item.state.get("place", "") for robot, items in snapshot.observed.items() for item in items
    }
    robots = sorted({row["robot"] for row in rows})
    if not robots:
        return []

    def ask(robot: str) -> list[int | None]:
        return _sizes(fleet, robot, [places[robot, row["volume"]] for row in rows if row["robot"] == robot])

    with concurrent.futures.ThreadPoolExecutor(len(robots)) as pool:
        sizes = {robot: iter(found) for robot, found in zip(robots, pool.map(ask, robots), strict=True)}
    every = ((row, next(sizes[row["robot"]])) for row in rows)
    return [{**row, "bytes": size if size is not None and size >= 0 else None} for row, size in every]


def _sizes(fleet: Fleet, robot: str, folders: Sequence[str]) -> list[int | None]:
    queries = [Query(command=f"du -s -B1 -- {quote(one)}", timeout_s=_DU_S) for one in folders]
    try:
        replies = fleet.sessions.get(robot).ask(queries)
    except TransportError:
        return [None] * len(folders)  # the list itself is what counts
    return [integer(one.out.partition("\t")[0], default=-1) if one.ok else None for one in replies]


def shown(rows: Sequence[Mapping[str, Any]], now: dt.datetime) -> list[dict[str, str]]:
    """Return the rows as people read them."""
    return [
        {
            "instance": row["instance"],
            "volume": row["volume"],
            "robot": row["robot"],
            "size": _size(row["bytes"]),
            "age": age_text(row["created"], now),
            "used by": "its services" if row["used"] else "nobody: kept",
        }
        for row in rows
    ]


def line(row: Mapping[str, Any], now: dt.datetime) -> str:
    """Return one volume in one line."""
    return f"{row['volume']} on {row['robot']} ({_size(row['bytes'])}, {age_text(row['created'], now)} old)"


def _size(number: int | None) -> str:
    return "size unknown" if number is None else size_text(number)


def remedy(row: Mapping[str, Any]) -> str:
    """Return the command that removes a kept volume, on its robot alone: the instance may well run on others.

    Which instance it is of is the word of its robot.
    """
    return f"srprov destroy --instance {quote(row['instance'])} --volumes --limit {quote(row['robot'])}"


def age_text(created: str, now: dt.datetime) -> str:
    """Return how long ago an engine's time was; a robot's clock may be wrong, so nothing is negative."""
    seconds = max(0, int(now.timestamp() - moment(created)))
    if not moment(created):
        return "age unknown"
    return next((f"{seconds // one} {unit}" for unit, one in _UNITS if seconds >= one), f"{seconds} s")
