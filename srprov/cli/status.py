"""`srprov status`: what of an instance runs where, and what of it is missing or wrong."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import click

from srprov.cli import inputs, options
from srprov.cli.codes import DIFFERENCES
from srprov.cli.output import err, out, out_json, tell_unreachable
from srprov.errors import DefinitionError, visible

if TYPE_CHECKING:
    from srprov.controller.status import Status
    from srprov.definitions.model import Experiment

_COLUMNS = ("instance", "service", "robot", "state", "health", "address", "image", "problem")
_KINDS = {"network": "Docker network", "vxlan": "VXLAN link"}
_LINKS = {"missing": "is not there", "down": "is down", "detached": "is not joined to the network"}


@click.command()
@click.argument("file", metavar="[FILE]", required=False)
@options.robots
@options.INSTANCE
@click.option("--volumes", is_flag=True, help="Show data volumes too, also those that are kept: robot, size, age.")
@click.option("--exit-code", is_flag=True, help="Exit with 2 when something of it is missing or wrong.")
def status(
    file: str | None, inventories: tuple[str, ...], as_json: bool, forks: int, timeout: float, instance: str,
    volumes: bool, exit_code: bool,
) -> int:  # fmt: skip
    """Show the running experiment; without FILE and --instance, every instance on the robots.

    PROBLEM names what is missing or wrong, with FILE also services that were never placed; `srprov apply` mends it.
    Services that only trials have are not missing while none of them has a container.

    Exits with 0; with 4 when a robot cannot be reached; else with 2 when --exit-code is given and something is missing
    or wrong.
    """
    from srprov.controller.kept import volume_rows, with_sizes
    from srprov.controller.status import status_of
    from srprov.facts.gather import Detail

    inventory = inputs.load_inventory(inventories)
    name = inputs.named_instance(file, instance)[0] if file or instance else ""
    experiment = _experiment(file, needed=exit_code) if file else None
    with inputs.connect(inventory, timeout, forks) as fleet:
        snapshot = fleet.gather(Detail.BASIC)
        kept = volume_rows(snapshot, name)
        if volumes:
            kept = with_sizes(kept, fleet, snapshot)
    seen = status_of(snapshot, name, experiment)
    for line in (*seen.disputes, *seen.notes, *filter(None, [seen.trials])):
        err(f"note: {visible(line)}")
    if as_json:
        listed = {"volumes": kept} if volumes else {}
        out_json({"services": seen.services, "links": seen.links, **listed, "unreachable": dict(snapshot.unreachable)})
    else:
        out(_text(seen) or f"nothing of {visible(name) or 'srprov'} runs on these robots")
        _show_data(kept, whole=volumes)
    nothing = bool(name) and not seen.services and not seen.trials
    wrong = DIFFERENCES if exit_code and (nothing or not seen.as_it_should_be) else 0
    return tell_unreachable(snapshot.unreachable) or wrong


def _experiment(file: str, *, needed: bool) -> Experiment | None:
    """Return what the EDF says; when it is not valid any more, say that it is not compared.

    Raises:
        DefinitionError: It is not valid, and `needed`.
    """
    try:
        return inputs.load_experiment(file).experiment
    except DefinitionError:
        if needed:
            raise
        err(f"note: {visible(file)} is not valid; what runs is compared with what robots remember")
        return None


def _text(seen: Status) -> str:
    rows = [{**row, "problem": _problem(row)} for row in seen.services]
    links = [
        f"{visible(link['robot'])}: {_KINDS[link['kind']]} {link['name']} of {visible(link['instance'])} "
        f"{_LINKS[link['problem']]}: its services reach no other robot"
        for link in seen.links
    ]
    return "\n".join([table(rows, _COLUMNS)] * bool(rows) + links)


def _show_data(kept: Sequence[Mapping[str, Any]], *, whole: bool) -> None:
    from srprov.controller.kept import COLUMNS, shown

    unused = sorted({f"{row['volume']} on {row['robot']}" for row in kept if not row["used"]})
    if whole and kept:
        out("\n" + table(shown(kept, dt.datetime.now(dt.timezone.utc)), COLUMNS))
    elif unused:
        out(f"data is kept: {', '.join(map(visible, unused))}; --volumes shows more")


def _problem(row: Mapping[str, Any]) -> str:
    """Return a row's problem in words."""
    more = {
        "duplicate": f" of the one on {row['placed_on']}",
        "misplaced": f": belongs on {row['placed_on']}",
        "address": f": should be {row['given_address']}",
        "unwanted": ": not in the experiment",
    }
    return f"{row['problem']}{more.get(row['problem'], '')}"


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
