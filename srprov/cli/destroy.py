"""`srprov destroy`: remove exactly what an instance owns, found by its labels, whatever the EDF says by now."""

from __future__ import annotations

import datetime as dt
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

import click

from srprov.cli import inputs, options, output_options
from srprov.cli.execute import carry_out, confirm, refuse_without_terminal
from srprov.cli.output import err
from srprov.cli.plan import show_plan
from srprov.controller.phases import Phases
from srprov.errors import visible
from srprov.session import Pulse

if TYPE_CHECKING:
    from srprov.controller.fleet import Fleet
    from srprov.facts.model import Snapshot


@click.command()
@click.argument("file", metavar="[FILE]", required=False)
@options.robots
@options.INSTANCE
@options.LIMIT
@options.EXCLUDE
@options.locking
@options.RUNS
@output_options.TIMINGS
@click.option("-y", "--yes", is_flag=True, help="Do not ask.")
@click.option("--volumes", is_flag=True, help="Remove data volumes too; their data is lost.")
@click.option("--adopt", is_flag=True, help="Also when another file made the instance.")
@output_options.EVENTS
@output_options.QUIET
@click.option("-v", "--verbose", is_flag=True, help="Show the exact commands of each step.")
@click.option("--no-color", is_flag=True, help="Plain text; so does NO_COLOR.")
def destroy(
    file: str | None, inventories: tuple[str, ...], as_json: bool, forks: int, timeout: float, instance: str,
    limit: str, exclude: str, yes: bool, volumes: bool, adopt: bool, events: TextIO | None, verbose: bool,
    no_color: bool, lock_wait: float, stop_timeout: float, pulse: Pulse, runs: Path | None,
) -> int:  # fmt: skip
    """Remove everything that an instance owns.

    The instance is the EDF's name, or --instance. Data volumes stay unless --volumes is given; images stay as a
    cache until `srprov images prune`.
    """
    refuse_without_terminal(yes)
    phases = Phases()
    inventory = inputs.load_inventory(inventories)
    name, source = inputs.named_instance(file, instance)
    chosen = inputs.selected(inventory, limit, exclude, inputs.failed_robots(name, runs))
    with inputs.connect(inventory, timeout, forks, changing=True) as fleet:
        phases.begin("facts")
        lock_wait = inputs.waited(fleet, name, lock_wait, chosen)
        from srprov.controller.owners import read_owner
        from srprov.controller.remove import make_removal, other_instances
        from srprov.execution import RunOptions

        owner = read_owner(name, file) if file else None
        planned = make_removal(fleet, name, volumes=volumes, source=source, adopt=adopt, owner=owner).limited(chosen)
        if not as_json and not (yes and output_options.is_quiet()):
            show_plan(planned.plan, None, verbose=verbose)
        if planned.snapshot and (others := other_instances(planned.snapshot, name, source)):
            err(f"note: the same file also made: {visible(', '.join(others))}; destroy them with --instance NAME")
        confirm(planned.plan, yes, stop_timeout)
        phases.begin("destroy")
        run_options = RunOptions(
            forks=forks, verb="destroy", stop_timeout_s=stop_timeout, lock_wait_s=lock_wait, pulse=pulse
        )
        code = carry_out(
            planned, fleet, run_options, phases, as_json=as_json, events=events, color=not no_color, runs=runs
        )
        if planned.snapshot and not volumes:
            _tell_kept(fleet, planned.snapshot, name)
        return code


def _tell_kept(fleet: Fleet, snapshot: Snapshot, instance: str) -> None:
    """Say where data stays: robot, size, age."""
    from srprov.controller.kept import line, volume_rows, with_sizes

    now = dt.datetime.now(dt.timezone.utc)
    for row in with_sizes(volume_rows(snapshot, instance), fleet, snapshot):
        err(f"data stays: {visible(line(row, now))}")
