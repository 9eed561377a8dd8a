"""`srprov run`: trials, one after the other."""

from __future__ import annotations

from typing import TYPE_CHECKING, TextIO

import click

from srprov.cli import inputs, options, output_options, trial_options
from srprov.cli.execute import refuse_without_terminal
from srprov.cli.output import err
from srprov.cli.seconds import Seconds
from srprov.cli.trial_session import Manner, check_wanted, run_session, show_report
from srprov.codes import Code
from srprov.controller.request import PlanRequest
from srprov.errors import UsageError

if TYPE_CHECKING:
    from srprov.controller.trial_request import TrialsRequest
    from srprov.definitions.model import Definitions
    from srprov.session import Pulse


@click.command()
@click.argument("file", metavar="FILE")
@options.robots
@options.locking
@options.planning
@trial_options.which
@options.LOCKED
@click.option("-y", "--yes", is_flag=True, help="Do not ask.")
@click.option("--wait-timeout", type=Seconds(min=0), default=300.0, show_default=True, metavar="S",
              help="Seconds for a service that is kept over all trials to become healthy.")  # fmt: skip
@output_options.EVENTS
@output_options.QUIET
@click.option("--no-color", is_flag=True, help="Plain text; so does NO_COLOR.")
def run(
    file: str, inventories: tuple[str, ...], as_json: bool, forks: int, timeout: float, request: PlanRequest,
    unreachable: str, lock_wait: float, stop_timeout: float, pulse: Pulse, wanted: TrialsRequest,
    locked: bool, yes: bool, wait_timeout: float, events: TextIO | None, no_color: bool,
) -> int:  # fmt: skip
    """Run the experiment's trials: every combination of its parameters, as often as the EDF says.

    Each trial makes its containers anew, waits until it has ended, brings logs and results home, and removes them.
    Ctrl-C ends the run after the present trial, a second one at once; --resume goes on.
    Trials need all their robots: --unreachable can only be `fail`.
    """
    from srprov.controller.source import read_definitions

    refuse_without_terminal(yes)
    if unreachable != "fail":
        raise UsageError("trials need all their robots", hint="leave --unreachable out", code=Code.OPTIONS)
    definitions = read_definitions(file, request.allowed, request.profiles, locked=locked)
    check_wanted(definitions, wanted)
    if wanted.discard:
        return _discard(definitions, wanted)
    manner = Manner(
        forks=forks, timeout=timeout, lock_wait=lock_wait, stop_timeout=stop_timeout, wait_timeout=wait_timeout,
        pulse=pulse, events=events, color=not no_color, as_json=as_json, yes=yes,
    )  # fmt: skip
    report = run_session(definitions, inputs.load_inventory(inventories), request, wanted, manner)
    show_report(report, as_json=as_json)
    return report.exit_code


def _discard(definitions: Definitions, wanted: TrialsRequest) -> int:
    """Note which trials count no more; no robot is asked."""
    from srprov.controller.trial_discard import discard

    for line in discard(definitions.experiment, wanted):
        err(line)
    return 0
