"""`srprov run`: trials, one after the other."""

from __future__ import annotations

import sys
import threading
import time
from contextlib import nullcontext
from typing import TYPE_CHECKING, TextIO

import click

from srprov.cli import inputs, options, output_options, trial_options
from srprov.cli.execute import confirm, refuse_without_terminal
from srprov.cli.interrupt import soft_interrupt
from srprov.cli.output import Answer, err, expect, is_terminal, out, out_json
from srprov.cli.plan import show_plan
from srprov.cli.progress import progress
from srprov.cli.seconds import Seconds
from srprov.cli.status_line import status_line
from srprov.cli.stdout_guard import answers_only
from srprov.controller.request import PlanRequest
from srprov.errors import RefusedError, UsageError

if TYPE_CHECKING:
    from srprov.controller.fleet import Fleet
    from srprov.controller.plan import Planned
    from srprov.controller.trial_plan import TrialPlan
    from srprov.controller.trial_report import TrialsReport
    from srprov.controller.trial_request import TrialsRequest
    from srprov.controller.trials import TrialNews
    from srprov.definitions.model import Definitions
    from srprov.execution import RunOptions
    from srprov.secret import Vault
    from srprov.session import Pulse

_SAID = b"\ninterrupted: the present trial goes on to its end, no new one begins; once more to end it at once\n"


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
    from srprov.controller.secrets import read_secrets
    from srprov.controller.source import read_definitions

    refuse_without_terminal(yes)
    if unreachable != "fail":
        raise UsageError("trials need all their robots", hint="leave --unreachable out")
    definitions = read_definitions(file, request.allowed, request.profiles, locked=locked)
    _check(definitions, wanted)
    if wanted.discard:
        return _discard(definitions, wanted)
    vault = read_secrets(definitions, request.allowed)
    inventory = inputs.load_inventory(inventories)
    request = inputs.with_own_files(request, definitions)
    with inputs.connect(inventory, timeout, forks, changing=True, vault=vault) as fleet:
        output_options.note(f"asking {len(inventory.hosts)} robots for facts")
        planned = _planned(definitions, fleet, request, vault)
        from srprov.controller.permissions import may_trigger, permit_run
        from srprov.controller.trial_plan import in_words, trial_plan
        from srprov.execution import RunOptions

        plan = trial_plan(planned, inventory, request.policies, resume=wanted.resume)
        if not as_json and not (yes and output_options.is_quiet()):
            show_plan(plan.base.plan, None, verbose=False)
            out(f"\n{in_words(plan)}")
        permit_run(planned.plan, request.allowed, inventory, request.policies)
        confirm(plan.base.plan, yes, stop_timeout, " and run the trials")
        run_options = RunOptions(
            forks=forks, wait_timeout_s=wait_timeout, stop_timeout_s=stop_timeout, lock_wait_s=lock_wait, pulse=pulse,
            triggers=may_trigger(request.allowed), verb="run",
        )  # fmt: skip
        report = _run(plan, fleet, wanted, run_options, events, color=not no_color)
    _show(report, as_json)
    return report.exit_code


def _check(definitions: Definitions, wanted: TrialsRequest) -> None:
    """Refuse what cannot be done, as far as is known without asking a robot."""
    from srprov.controller.trial_run import check_request

    check_request(definitions.experiment, wanted)
    given = definitions.experiment.trials
    if given is not None and given.settings.prompt and not (sys.stdin.isatty() or wanted.discard):
        raise RefusedError("a person is asked between two trials, and there is no terminal", hint="see `between`")


def _discard(definitions: Definitions, wanted: TrialsRequest) -> int:
    """Note which trials count no more; no robot is asked."""
    from srprov.controller.trial_discard import discard

    for line in discard(definitions.experiment, wanted):
        err(line)
    return 0


def _planned(definitions: Definitions, fleet: Fleet, request: PlanRequest, vault: Vault) -> Planned:
    with fleet.look(definitions.experiment) as look, answers_only():
        from srprov.controller.plan import make_plan  # a tenth of a second of imports, while the robots are asked

        return make_plan(definitions, look, request, vault)


def _run(
    plan: TrialPlan, fleet: Fleet, wanted: TrialsRequest, run_options: RunOptions, events: TextIO | None, *, color: bool
) -> TrialsReport:
    """Run them, and show what happens."""
    from srprov.controller.trial_run import run_trials

    expect(Answer.ASIDE)
    stop, quiet = threading.Event(), output_options.is_quiet()
    shown = _Shown()
    alone = quiet or bool(plan.given.settings.prompt) or not is_terminal(sys.stderr)
    live = nullcontext() if alone else status_line(lambda: shown.status, color=color)
    listening = progress(plan.base.plan, events=events, color=color, quiet=quiet, lines_only=True)
    try:
        with live, listening as listener, soft_interrupt(stop, _SAID):
            return run_trials(plan, fleet, wanted, run_options, listener, shown.say, stop, _pause)
    except OSError as error:
        hint = "what is in the folder is whole; go on with --resume when there is room"
        raise UsageError(f"{error.filename or 'the run'}: {error.strerror or error}", hint=hint) from error


class _Shown:
    """Says how attempts of trials ended, and on a terminal what the present one does."""

    def __init__(self) -> None:
        self.status = "starting"

    def say(self, news: TrialNews) -> None:
        """Show one moment of a trial."""
        values = "".join(f" {name}={value}" for name, value in news.values.items())
        line = f"[{news.order}/{news.trials}] {news.trial}{values}: {news.what}"
        if news.aloud:
            output_options.note(line)
        self.status = line


def _pause(seconds: float, prompt: str) -> None:
    """Wait between two trials, for a person too where there is one."""
    if prompt and sys.stdin.isatty():
        err(f"{prompt}; then press Enter")
        input()
    time.sleep(seconds)


def _show(report: TrialsReport, as_json: bool) -> None:
    """Say what came of the run, and how to read it."""
    if as_json:
        out_json(report.document)
    if report.base is not None:
        for line in report.base.failures:
            err(line)
    for line in report.in_words():
        err(line)
    if report.ended_early:
        err(f"the run ended early: {report.ended_early}; go on with --resume -o {report.folder}")
    if not as_json:
        out(f"{report.folder}/trials.csv")
    err(report.loading)
