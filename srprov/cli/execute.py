"""What `apply` and `destroy` share: the question, the run with its progress, the report and the exit code."""

from __future__ import annotations

import shlex
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

import click

from srprov.cli.interrupt import soft_interrupt
from srprov.cli.output import Answer, err, err_whole, expect, out_json
from srprov.cli.output_options import is_quiet, wants_timings
from srprov.cli.progress import progress
from srprov.cli.timings import timings_text
from srprov.codes import Code
from srprov.errors import RefusedError, visible

if TYPE_CHECKING:
    from srprov.controller.fleet import Fleet
    from srprov.controller.phases import Phases
    from srprov.controller.plan import Planned
    from srprov.controller.run import RunReport
    from srprov.execution import RunOptions
    from srprov.planning.plan import Plan


def refuse_without_terminal(yes: bool) -> None:
    """A question that nobody can answer is refused before anything is done."""
    if not yes and not sys.stdin.isatty():
        raise RefusedError(
            "there is no terminal to ask on", hint="add --yes to go on without being asked", code=Code.NO_TERMINAL
        )


def confirm(made: Plan, yes: bool, stop_timeout_s: float, also: str = "") -> None:
    """Say who gets less time to stop than it asks for; ask before anything is changed, unless the user said yes.

    `also` is what is done besides the plan, and is asked about where the plan is empty too.
    """
    if made.empty and not also:
        return
    from srprov.execution.options import hurried

    for line in hurried(made, stop_timeout_s):
        err_whole(f"warning: {visible(line)}")
    if yes:
        return
    lost = sum(step.change.destructive for step in made.steps)
    question = f"Do this{also}?" if not lost else f"Do this{also}? {lost} steps destroy data."
    if not click.confirm(question, err=True):
        raise RefusedError("not confirmed; nothing was changed", code=Code.NOT_CONFIRMED)


def carry_out(
    planned: Planned, fleet: Fleet, run_options: RunOptions, phases: Phases, *, as_json: bool, events: TextIO | None,
    color: bool, runs: Path | None,
) -> int:  # fmt: skip
    """Run the plan, show what happens, report, and return the exit code."""
    return carried_out(
        planned, fleet, run_options, phases, as_json=as_json, events=events, color=color, runs=runs
    ).result.exit_code


def carried_out(
    planned: Planned, fleet: Fleet, run_options: RunOptions, phases: Phases, *, as_json: bool, events: TextIO | None,
    color: bool, runs: Path | None,
) -> RunReport:  # fmt: skip
    """Run the plan, show what happens, report, and return what came of it."""
    from srprov.controller.report import summary
    from srprov.controller.run import run

    if as_json:  # the plan was not shown, and it is what says these
        for note in planned.plan.notes:
            err_whole(f"note: {visible(note)}")
    else:
        expect(Answer.ASIDE)
    stop = threading.Event()
    with progress(planned.plan, events=events, color=color, quiet=is_quiet()) as listener, soft_interrupt(stop):
        report = run(planned, fleet, run_options, phases, listener, stop, runs=runs)
    if as_json:
        out_json(report.document)
    for line in (*report.failures, *report.jobs):
        err(line)
    if report.record_problem:
        err(f"warning: the record of this run is not complete: {report.record_problem}")
    if report.document["failed"] and report.document["run"]:
        err(f"its record: srprov runs show {shlex.quote(_named(Path(report.document['run'])))}")
    err(summary(report.document, report.result))
    if wants_timings():
        err(timings_text(report.document["phases"], report.document["robots"]))
    return report


def _named(folder: Path) -> str:
    """Return what `runs show` takes for a record: its name where it is looked for, else its folder."""
    from srprov.record import default_root

    return folder.name if folder.parent == default_root() else str(folder)
