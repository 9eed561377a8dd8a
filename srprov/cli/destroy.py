"""`srprov destroy`: remove exactly what an instance owns, found by its labels, whatever the EDF says by now."""

from __future__ import annotations

from pathlib import Path
from typing import TextIO

import click

from srprov.cli import options, output_options
from srprov.cli.apply import Phases, refuse_without_terminal
from srprov.cli.execute import Task, carry_out, confirm
from srprov.cli.output import err
from srprov.cli.plan import show_plan
from srprov.cli.waiting import wait_for_other_runs
from srprov.errors import UsageError, visible
from srprov.planning.limit import limited
from srprov.wire import Pulse


@click.command()
@click.argument("file", required=False)
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
    no_color: bool, lock_wait: float, pulse: Pulse, runs: Path | None,
) -> int:  # fmt: skip
    """Remove everything that an instance owns.

    The instance is the EDF's name, or --instance. Data volumes stay unless --volumes is given; images stay as a cache.
    """
    from srprov.controller import make_removal
    from srprov.execution import RunOptions
    from srprov.saved import removal_file

    refuse_without_terminal(yes)
    phases = Phases()
    inventory = options.load_inventory(inventories)
    name, source = named_instance(file, instance)
    chosen = options.selected(inventory, limit, exclude, options.failed_robots(name, runs))
    with options.open_lab(inventory, timeout, forks, locks=True) as lab:
        phases.begin("facts")
        lock_wait = wait_for_other_runs(lab, name, lock_wait, forks)
        made, found = make_removal(
            name, inventory, lab.sessions.get, volumes=volumes, forks=forks, source=source, adopt=adopt
        )
        made = limited(made, chosen)
        if not as_json and not (yes and output_options.is_quiet()):
            show_plan(made, None, verbose=verbose)
        others = other_names(found, name, source)
        if others:
            err(f"note: the same file also made: {visible(', '.join(others))}; destroy them with --instance NAME")
        confirm(made, yes)
        phases.begin("destroy")
        run_options = RunOptions(forks=forks, verb="destroy", lock_wait_s=lock_wait, pulse=pulse)
        task = Task(plan=made, file=lambda: removal_file(made, found), snapshot=found)
        return carry_out(task, lab, run_options, phases, as_json=as_json, events=events, color=not no_color, runs=runs)


def named_instance(file: str | None, instance: str) -> tuple[str, str]:
    """Return the instance's id and, when an EDF is named, its source; the EDF need not be valid any more for that.

    Raises:
        UsageError: Neither an EDF nor --instance is given.
    """
    if file is None:
        if not instance:
            raise UsageError("which experiment?", hint="name its EDF, or --instance ID")
        return instance, ""
    from srprov.definitions.named import experiment_name
    from srprov.definitions.source import source_of

    return instance or experiment_name(file), source_of(str(Path(file).resolve()))


def other_names(found: object, name: str, source: str) -> list[str]:
    """Return instances on the robots that came from the same source under another name."""
    from srprov.facts.model import Snapshot

    assert isinstance(found, Snapshot)
    owners = {
        e.instance for items in found.observed.values() for e in items if source and e.state.get("source") == source
    }
    return sorted(owners - {name, ""})
