"""`srprov status`: what of an instance runs where."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import click

from srprov.cli import options
from srprov.cli.destroy import named_instance
from srprov.cli.output import err, out, out_json
from srprov.errors import visible

if TYPE_CHECKING:
    from srprov.facts.model import Snapshot

UNREACHABLE = 4


@click.command()
@click.argument("file", required=False)
@options.robots
@options.INSTANCE
def status(
    file: str | None, inventories: tuple[str, ...], as_json: bool, forks: int, timeout: float, instance: str
) -> int:
    """Show the running experiment; without FILE and --instance, every instance on the robots."""
    from srprov.facts.gather import Detail, gather

    inventory = options.load_inventory(inventories)
    name = named_instance(file, instance)[0] if file or instance else ""
    with options.open_lab(inventory, timeout, forks) as lab:
        found = gather(inventory, lab.sessions.get, closer=Detail.NO, forks=forks)
    rows = status_rows(found, name)
    if as_json:
        out_json({"services": rows, "unreachable": dict(found.unreachable)})
    elif rows:
        out(table(rows, ("instance", "service", "robot", "state", "health", "address", "image")))
    else:
        out(f"nothing of {name or 'srprov'} on these robots")
    for host, reason in sorted(found.unreachable.items()):
        err(f"unreachable: {host}: {reason}")
    return UNREACHABLE if found.unreachable else 0


def status_rows(snapshot: Snapshot, name: str) -> list[dict[str, Any]]:
    """Return one row per container, and one per service that is known to be on a robot that cannot be reached."""
    rows = []
    for host, items in snapshot.observed.items():
        for item in items:
            if item.module == "container" and name in ("", item.instance):
                rows.append(_row(item.instance, item.state["service"], host, item.state))
    for instance, record in snapshot.placements.items():
        services = record.get("services")
        if name in ("", instance) and isinstance(services, Mapping):
            for service, entry in services.items():
                robot = entry.get("robot") if isinstance(entry, Mapping) else None
                if robot in snapshot.unreachable:
                    rows.append(_row(instance, str(service), str(robot), {"status": "unreachable", "addresses": {}}))
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


def table(rows: Sequence[Mapping[str, Any]], columns: Sequence[str]) -> str:
    """Return rows as aligned text; a column in which nobody has anything is left out. No cell can begin a row."""
    used = [column for column in columns if any(str(row[column]) for row in rows)]
    lines = [[column.upper() for column in used]] + [
        [visible(str(row[column])) or "-" for column in used] for row in rows
    ]
    widths = [max(len(line[index]) for line in lines) for index in range(len(used))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip() for line in lines
    )
