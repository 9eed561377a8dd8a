"""`srprov destroy`: remove exactly what an instance owns, found by its labels, whatever the EDF says by now."""

from __future__ import annotations

import datetime as dt
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

import click
import msgspec

from srprov.cli import inputs, options, output_options
from srprov.cli.destroy_all import check_all, destroy_all
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
@click.option("--all-instances", "every", is_flag=True,
              help="All instances on the robots; with FILE, all that it made. Lists them, and asks.")  # fmt: skip
@output_options.EVENTS
@output_options.QUIET
@click.option("-v", "--verbose", is_flag=True, help="Show the exact commands of each step.")
@click.option("--no-color", is_flag=True, help="Plain text; so does NO_COLOR.")
def destroy(
    file: str | None, inventories: tuple[str, ...], as_json: bool, forks: int, timeout: float, instance: str,
    limit: str, exclude: str, yes: bool, volumes: bool, adopt: bool, every: bool, events: TextIO | None, verbose: bool,
    no_color: bool, lock_wait: float, stop_timeout: float, pulse: Pulse, runs: Path | None,
) -> int:  # fmt: skip
    """Remove everything that an instance owns.

    The instance is the EDF's name, or --instance. Data volumes stay unless --volumes is given; images stay as a
    cache until `srprov images prune`.
    """
    if every:
        check_all(file, instance, as_json=as_json, volumes=volumes, adopt=adopt)
    refuse_without_terminal(yes)
    inventory = inputs.load_inventory(inventories)
    name, source = ("", "") if every and file is None else inputs.named_instance(file, instance)
    chosen = inputs.selected(inventory, limit, exclude, inputs.failed_robots(name, runs) if name else None)
    with inputs.connect(inventory, timeout, forks, changing=True) as fleet:

        def remove(name: str, *, yes: bool) -> int:
            how = _How(
                file=file, name=name, source=source, every=every, yes=yes, volumes=volumes, adopt=adopt,
                as_json=as_json, verbose=verbose, color=not no_color, events=events, runs=runs,
            )  # fmt: skip
            return _destroy(how, fleet, chosen, forks, lock_wait, stop_timeout, pulse)

        if every:
            return destroy_all(
                fleet, source, chosen, lambda one: remove(one, yes=True), yes=yes, volumes=volumes, adopt=adopt
            )
        return remove(name, yes=yes)


class _How(msgspec.Struct, frozen=True, kw_only=True):
    """What the user wants of one instance's end."""

    file: str | None
    name: str
    source: str
    every: bool
    """It is one of several that are destroyed."""
    yes: bool
    volumes: bool
    adopt: bool
    as_json: bool
    verbose: bool
    color: bool
    events: TextIO | None
    runs: Path | None


def _destroy(
    how: _How, fleet: Fleet, chosen: Collection[str], forks: int, lock_wait: float, stop_timeout: float, pulse: Pulse
) -> int:
    """Remove one instance: show what, ask, do it, say which data stays."""
    phases = Phases()
    phases.begin("facts")
    lock_wait = inputs.waited(fleet, how.name, lock_wait, chosen)
    from srprov.controller.owners import read_owner
    from srprov.controller.remove import make_removal, other_instances
    from srprov.execution import RunOptions

    owner = read_owner(how.name, how.file) if how.file else None
    planned = make_removal(
        fleet, how.name, volumes=how.volumes, source=how.source, adopt=how.adopt, owner=owner
    ).limited(chosen)
    if not how.as_json and not (how.yes and output_options.is_quiet()):
        show_plan(planned.plan, None, verbose=how.verbose)
    others = other_instances(planned.snapshot, how.name, how.source) if planned.snapshot and not how.every else []
    if others:
        told = visible(", ".join(others))
        err(f"note: the same file also made: {told}; destroy them with --instance NAME, or all with --all-instances")
    confirm(planned.plan, how.yes, stop_timeout)
    phases.begin("destroy")
    run_options = RunOptions(
        forks=forks, verb="destroy", stop_timeout_s=stop_timeout, lock_wait_s=lock_wait, pulse=pulse
    )
    code = carry_out(
        planned, fleet, run_options, phases, as_json=how.as_json, events=how.events, color=how.color, runs=how.runs
    )
    if planned.snapshot and not how.volumes:
        _tell_kept(fleet, planned.snapshot, how.name)
    return code


def _tell_kept(fleet: Fleet, snapshot: Snapshot, instance: str) -> None:
    """Say where data stays: robot, size, age."""
    from srprov.controller.kept import line, volume_rows, with_sizes

    now = dt.datetime.now(dt.timezone.utc)
    for row in with_sizes(volume_rows(snapshot, instance), fleet, snapshot):
        err(f"data stays: {visible(line(row, now))}")
