"""`srprov status`: what of an instance runs where."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping, Sequence
from typing import Any

import click

from srprov.cli import inputs, options
from srprov.cli.output import out, out_json, tell_unreachable
from srprov.errors import visible


@click.command()
@click.argument("file", metavar="[FILE]", required=False)
@options.robots
@options.INSTANCE
@click.option("--volumes", is_flag=True, help="Show data volumes too, also those that are kept: robot, size, age.")
def status(
    file: str | None, inventories: tuple[str, ...], as_json: bool, forks: int, timeout: float, instance: str,
    volumes: bool,
) -> int:  # fmt: skip
    """Show the running experiment; without FILE and --instance, every instance on the robots."""
    from srprov.controller.kept import COLUMNS, shown, volume_rows, with_sizes
    from srprov.controller.status import status_rows
    from srprov.facts.gather import Detail

    inventory = inputs.load_inventory(inventories)
    name = inputs.named_instance(file, instance)[0] if file or instance else ""
    with inputs.connect(inventory, timeout, forks) as fleet:
        snapshot = fleet.gather(Detail.BASIC)
        kept = volume_rows(snapshot, name)
        if volumes:
            kept = with_sizes(kept, fleet, snapshot)
    rows = status_rows(snapshot, name)
    if as_json:
        listed = {"volumes": kept} if volumes else {}
        out_json({"services": rows, **listed, "unreachable": dict(snapshot.unreachable)})
        return tell_unreachable(snapshot.unreachable)
    if rows:
        out(table(rows, ("instance", "service", "robot", "state", "health", "address", "image")))
    else:
        out(f"nothing of {name or 'srprov'} runs on these robots")
    unused = sorted({f"{row['volume']} on {row['robot']}" for row in kept if not row["used"]})
    if volumes and kept:
        out("\n" + table(shown(kept, dt.datetime.now(dt.timezone.utc)), COLUMNS))
    elif unused:
        out(f"data is kept: {', '.join(map(visible, unused))}; --volumes shows more")
    return tell_unreachable(snapshot.unreachable)


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
