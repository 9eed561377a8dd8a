"""`srprov status`: what of an instance runs where, and what of it is missing or wrong."""

from __future__ import annotations

import datetime as dt
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from srprov.cli import inputs, options
from srprov.cli.codes import DIFFERENCES
from srprov.cli.output import err, out, out_anew, out_json, tell_unreachable
from srprov.cli.status_wide import WIDE_COLUMNS, wide_columns
from srprov.codes import Code
from srprov.errors import DefinitionError, UsageError, visible

if TYPE_CHECKING:
    from srprov.controller.fleet import Fleet
    from srprov.controller.status import Status
    from srprov.definitions.model import Experiment

_COLUMNS = ("instance", "service", "robot", "state", "health", "cpu", "memory", "address", "image", "problem")
_AGAIN_S = 2.0
_KINDS = {
    "network": "Docker network",
    "vxlan": "VXLAN link",
    "vxlan_filter": "VXLAN filter",
    "wireguard": "WireGuard of",
}
_CUT, _OPEN = "its services reach no other robot", "any host may send to its services; apply mends it"
_LINKS = {
    "missing": "is not there",
    "isolated": "is not there since a reboot",
    "down": "is down",
    "detached": "is not joined to the network",
    "incomplete": "lacks rules",
}


@click.command()
@click.argument("file", metavar="[FILE]", required=False)
@options.robots
@options.INSTANCE
@options.RUNS
@click.option(
    "--wide", is_flag=True, help="Show more of each container: name, ports, volumes, exit code, restarts, since."
)
@click.option("--volumes", is_flag=True, help="Show data volumes too, also those that are kept: robot, size, age.")
@click.option(
    "--network", is_flag=True, help="Show what the last apply that tried the overlay found; `probe` tries it now."
)
@click.option("--watch", is_flag=True, help="Look again every 2 s, also at CPU and memory, until Ctrl-C.")
@click.option("--exit-code", is_flag=True, help="Exit with 2 when something of it is missing or wrong.")
def status(
    file: str | None, inventories: tuple[str, ...], as_json: bool, forks: int, timeout: float, instance: str,
    runs: Path | None, wide: bool, volumes: bool, network: bool, watch: bool, exit_code: bool,
) -> int:  # fmt: skip
    """Show the running experiment; without FILE and --instance, every instance on the robots.

    PROBLEM names what is missing or wrong, with FILE also services that were never placed. `srprov apply` mends it,
    except for jobs that failed or were stopped and unhealthy services: `srprov restart` is for those. Services that
    only trials have are not missing while none of them has a container.

    With --wide, SINCE is when a container started or, of one that has ended, ended, by its robot's clock.

    With --watch, CPU is of one processor, and memory without the files that are cached.

    Exits with 0; with 4 when a robot cannot be reached; else with 2 when --exit-code is given and something is missing
    or wrong.
    """
    from srprov.controller.kept import volume_rows, with_sizes
    from srprov.controller.status import status_of
    from srprov.facts.gather import Detail

    _check_watch(watch, beside=as_json or wide or volumes or exit_code or network)
    inventory = inputs.load_inventory(inventories)
    name, source = inputs.named_instance(file, instance) if file or instance else ("", "")
    experiment = _experiment(file, needed=exit_code) if file else None
    with inputs.connect(inventory, timeout, forks) as fleet:
        if watch:
            _watch(fleet, name, experiment)
        snapshot = fleet.gather(Detail.BASIC)
        inputs.tell_maker(snapshot, name, source)
        kept = with_sizes(volume_rows(snapshot, name), fleet, snapshot) if volumes else volume_rows(snapshot, name)
        seen = status_of(snapshot, name, experiment, lambda one: _by_trials(one, runs))
        rows = _wide(seen, fleet) if wide else seen.services
    tried = _tried(name, runs) if network else None
    for line in (*seen.disputes, *seen.notes, *filter(None, [seen.trials])):
        err(f"note: {visible(line)}")
    if as_json:
        listed = ({"volumes": kept} if volumes else {}) | ({"network": tried} if network else {})
        out_json({"services": rows, "links": seen.links, **listed, "unreachable": dict(snapshot.unreachable)})
    else:
        out(_text(seen, rows) or f"nothing of {visible(name) or 'srprov'} runs on these robots")
        _show_more(kept, tried, volumes=volumes, network=network)
    nothing = bool(name) and not seen.services and not seen.trials
    wrong = DIFFERENCES if exit_code and (nothing or not seen.as_it_should_be) else 0
    return tell_unreachable(snapshot.unreachable) or wrong


def _by_trials(instance: str, runs: Path | None) -> bool:
    """Return whether the last record of an instance on this machine is of a run of trials."""
    from srprov.record import default_root, last_verb

    return last_verb(runs or default_root(), instance) == "run"


def _check_watch(watch: bool, *, beside: bool) -> None:
    """Refuse --watch with what shows the experiment in another way."""
    if watch and beside:
        hint = "leave out --json, --wide, --volumes, --network and --exit-code"
        raise UsageError("--watch goes with no other way to show it", hint=hint, code=Code.OPTIONS)


def _wide(seen: Status, fleet: Fleet) -> list[dict[str, Any]]:
    from srprov.controller.wide import wide_rows

    addresses = {robot: host.address for robot, host in fleet.inventory.hosts.items()}
    return wide_rows(seen.services, addresses, fleet.connected())


def _tried(name: str, runs: Path | None) -> dict[str, Any] | None:
    """Return what the last run of this machine that tried the overlay found, with its record; None: none did.

    Raises:
        UsageError: No instance is named.
    """
    from srprov.controller.probe import last_probe
    from srprov.record import default_root

    if not name:
        raise UsageError("--network is about one experiment", hint="name its EDF, or --instance ID", code=Code.OPTIONS)
    last = last_probe(runs or default_root(), name)
    return {"run": str(last[0]), "probe": dict(last[1])} if last else None


def _network_text(tried: Mapping[str, Any] | None) -> str:
    if tried is None:
        return "no apply on this machine has tried the overlay; `srprov probe` does it now"
    from srprov.probing.document import text

    begun = dt.datetime.strptime(tried["run"].rpartition("/")[2][:16], "%Y%m%dT%H%M%S%z")
    try:
        return f"the overlay as the run of {begun:%Y-%m-%d %H:%M:%S} UTC found it:\n{text(tried['probe'])}"
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise UsageError(
            f"{tried['run']}/probe.json cannot be read: {error!r}", hint="remove it", code=Code.RECORD
        ) from error


def _watch(fleet: Fleet, name: str, experiment: Experiment | None) -> NoReturn:
    """Show what there is again and again, until Ctrl-C."""
    from srprov.controller.live import Live
    from srprov.controller.status import status_of
    from srprov.facts.gather import Detail

    live = Live()
    while True:
        begun = time.monotonic()
        snapshot = fleet.gather(Detail.BASIC)
        seen = status_of(snapshot, name, experiment)
        rows = live.rows(seen.services, fleet.connected())
        out_anew(_text(seen, rows) or f"nothing of {visible(name) or 'srprov'} runs on these robots")
        tell_unreachable(snapshot.unreachable)
        time.sleep(max(0.0, begun + _AGAIN_S - time.monotonic()))


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


def _text(seen: Status, services: Sequence[Mapping[str, Any]] | None = None) -> str:
    shown = seen.services if services is None else services
    wide = bool(shown) and "wide" in shown[0]
    rows = [{**row, "problem": _problem(row), **(wide_columns(row) if wide else _used(row))} for row in shown]
    links = [
        f"{visible(link['robot'])}: {_KINDS[link['kind']]} {link['name']} of {visible(link['instance'])} "
        f"{_LINKS[link['problem']]}: {_CUT if link['kind'] != 'vxlan_filter' else _OPEN}"
        for link in seen.links
    ]
    return "\n".join([table(rows, WIDE_COLUMNS if wide else _COLUMNS)] * bool(rows) + links)


def _show_more(
    kept: Sequence[Mapping[str, Any]], tried: Mapping[str, Any] | None, *, volumes: bool, network: bool
) -> None:
    _show_data(kept, whole=volumes)
    if network:
        out("\n" + _network_text(tried))


def _show_data(kept: Sequence[Mapping[str, Any]], *, whole: bool) -> None:
    from srprov.controller.kept import COLUMNS, shown

    unused = sorted({f"{row['volume']} on {row['robot']}" for row in kept if not row["used"]})
    if whole and kept:
        out("\n" + table(shown(kept, dt.datetime.now(dt.timezone.utc)), COLUMNS))
    elif unused:
        out(f"data is kept: {', '.join(map(visible, unused))}; --volumes shows more")


def _used(row: Mapping[str, Any]) -> dict[str, str]:
    """Return a row's columns of what it uses; empty where that is not known, or not asked for."""
    percent, memory = row.get("cpu_percent"), row.get("memory_bytes")
    return {
        "cpu": "" if percent is None else f"{percent:.0f} %",
        "memory": "" if memory is None else f"{memory / 2**20:.1f} MiB",
    }


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
    """Return rows as aligned text; a column in which nobody has anything is left out. No text can begin a row."""
    used = [column for column in columns if any(str(row[column]) for row in rows)]
    lines = [[visible(column).upper() for column in used]] + [
        [visible(str(row[column])) or "-" for column in used] for row in rows
    ]
    widths = [max(len(line[index]) for line in lines) for index in range(len(used))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip() for line in lines
    )
