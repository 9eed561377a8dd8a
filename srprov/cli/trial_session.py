"""A run of trials from the command line: the plan is shown, the user asked, and what happens told."""

from __future__ import annotations

import shlex
import sys
import threading
import time
from contextlib import nullcontext
from typing import TYPE_CHECKING, TextIO

import msgspec
from msgspec.structs import replace

from srprov.cli import inputs, output_options
from srprov.cli.execute import confirm
from srprov.cli.interrupt import soft_interrupt
from srprov.cli.output import Answer, err, expect, is_terminal, out, out_json, out_whole
from srprov.cli.plan import show_plan
from srprov.cli.progress import progress
from srprov.cli.status_line import status_line
from srprov.cli.stdout_guard import answers_only
from srprov.codes import Code
from srprov.errors import RefusedError, UsageError, visible

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from srprov.controller.fleet import Fleet
    from srprov.controller.plan import Planned
    from srprov.controller.request import PlanRequest
    from srprov.controller.trial_plan import TrialPlan
    from srprov.controller.trial_report import TrialsReport
    from srprov.controller.trial_request import TrialsRequest
    from srprov.controller.trials import TrialNews
    from srprov.definitions.model import Definitions, Inventory
    from srprov.execution import RunOptions
    from srprov.facts.model import Snapshot
    from srprov.secret import Vault
    from srprov.session import Pulse

_LONGEST = 1000
"""Characters of a line of somebody else's."""
_SAID = b"\ninterrupted: the present trial goes on to its end, no new one begins; once more to end it at once\n"


class Manner(msgspec.Struct, frozen=True, kw_only=True):
    """How the user wants it done and told."""

    forks: int
    timeout: float
    lock_wait: float
    stop_timeout: float
    wait_timeout: float
    pulse: Pulse
    events: TextIO | None
    color: bool
    as_json: bool
    yes: bool


def check_wanted(definitions: Definitions, wanted: TrialsRequest) -> None:
    """Refuse what cannot be done, as far as is known without asking a robot.

    Raises:
        UsageError, RefusedError: So it is.
    """
    from srprov.controller.own_output import refuse_shipped
    from srprov.controller.trial_folder import of_runs
    from srprov.controller.trial_run import check_request

    check_request(definitions.experiment, wanted)
    if not wanted.discard:
        refuse_shipped(definitions, wanted.folder or of_runs())
    given = definitions.experiment.trials
    if given is not None and given.settings.prompt and not (sys.stdin.isatty() or wanted.discard):
        raise RefusedError(
            "a person is asked between two trials, and there is no terminal",
            hint="see `between`",
            code=Code.NO_TERMINAL,
        )


def run_session(
    definitions: Definitions, inventory: Inventory, request: PlanRequest, wanted: TrialsRequest, manner: Manner,
    more: Callable[[Snapshot], Iterable[tuple[str, Iterable[str]]]] = lambda _snapshot: (),
) -> TrialsReport:  # fmt: skip
    """Plan, show, ask, and run trials.

    Args:
        definitions: What is run.
        inventory: The robots.
        request: What the user asks of the plan.
        wanted: Which trials, and where they are kept.
        manner: How it is done.
        more: Headings, each with lines that are shown with the plan; their words may be a stranger's.

    Raises:
        SrprovError: It cannot be, or is not allowed.
    """
    from srprov.controller.secrets import read_secrets

    vault = read_secrets(definitions, request.allowed)
    request = replace(inputs.with_own_files(request, definitions.experiment), trials=True)
    with inputs.connect(inventory, manner.timeout, manner.forks, changing=True, vault=vault) as fleet:
        output_options.note(f"asking {len(inventory.hosts)} robots for facts")
        planned = _planned(definitions, fleet, request, vault)
        from srprov.controller.permissions import may_trigger, permit_run
        from srprov.controller.trial_plan import in_words, trial_plan
        from srprov.controller.trial_values import size_note
        from srprov.execution import RunOptions

        plan = trial_plan(planned, inventory, request.policies, resume=wanted.resume)
        if not manner.as_json and not (manner.yes and output_options.is_quiet()):
            show_plan(plan.base.plan, None, verbose=False)
            out_whole(f"\n{in_words(plan)}")
            if size := size_note(plan.given):
                out_whole(f"\n{size}")
            for heading, lines in more(planned.snapshot) if planned.snapshot else ():
                out_whole("\n".join([f"\n{heading}:\n", *(f"  {visible(line[:_LONGEST])}" for line in lines)]))
        permit_run(planned.plan, request.allowed, inventory, request.policies)
        confirm(plan.base.plan, manner.yes, manner.stop_timeout, " and run the trials")
        run_options = RunOptions(
            forks=manner.forks, wait_timeout_s=manner.wait_timeout, stop_timeout_s=manner.stop_timeout,
            lock_wait_s=manner.lock_wait, pulse=manner.pulse, verb="run",
            triggers=may_trigger(request.allowed, inventory, request.policies),
        )  # fmt: skip
        return _run(plan, fleet, wanted, run_options, manner)


def _planned(definitions: Definitions, fleet: Fleet, request: PlanRequest, vault: Vault) -> Planned:
    with fleet.look(definitions.experiment) as look, answers_only():
        from srprov.controller.plan import make_plan  # a tenth of a second of imports, while the robots are asked

        return make_plan(definitions, look, request, vault)


def _run(plan: TrialPlan, fleet: Fleet, wanted: TrialsRequest, run_options: RunOptions, manner: Manner) -> TrialsReport:
    """Run them, and show what happens."""
    from srprov.controller.trial_run import run_trials

    expect(Answer.ASIDE)
    stop, quiet = threading.Event(), output_options.is_quiet()
    shown = _Shown()
    alone = quiet or bool(plan.given.settings.prompt) or not is_terminal(sys.stderr)
    live = nullcontext() if alone else status_line(lambda: shown.status, color=manner.color)
    listening = progress(plan.base.plan, events=manner.events, color=manner.color, quiet=quiet, lines_only=True)
    try:
        with live, listening as listener, soft_interrupt(stop, _SAID):
            return run_trials(plan, fleet, wanted, run_options, listener, shown.say, stop, _pause)
    except OSError as error:
        hint = "what is in the folder is whole; go on with --resume when there is room"
        raise UsageError(
            f"{error.filename or 'the run'}: {error.strerror or error}", hint=hint, code=Code.CANNOT_WRITE
        ) from error


class _Shown:
    """Says how attempts of trials ended, and on a terminal what the present one does."""

    def __init__(self) -> None:
        self.status = "starting"

    def say(self, news: TrialNews) -> None:
        """Show one moment of a trial."""
        values = "".join(f" {name}={value}" for name, value in news.values.items())
        line = visible(f"[{news.order}/{news.trials}] {news.trial}{values}: {news.what}")
        if news.aloud:
            output_options.note(line)
        self.status = line


def _pause(seconds: float, prompt: str) -> None:
    """Wait between two trials, for a person too where there is one, who is told whose words he is asked with."""
    if prompt and sys.stdin.isatty():
        err(f"the experiment asks: {visible(prompt)}; then press Enter")
        input()
    time.sleep(seconds)


def show_report(report: TrialsReport, *, as_json: bool) -> None:
    """Say what came of the run, and how to read it."""
    if as_json:
        out_json(report.document)
    if report.base is not None:
        for line in report.base.failures:
            err(line)
    for line in report.in_words():
        err(line)
    if report.ended_early:
        err(f"the run ended early: {visible(report.ended_early)}")  # what robots said may be in it, a remedy too
        err(f"  go on with --resume -o {shlex.quote(str(report.folder))}")
    if report.forgetful:
        err(f"warning: images of this run cannot be bundled: {report.forgetful}")
    if not (report.folder / "trials.csv").is_file():  # what comes before the first trial went wrong
        return
    if not as_json:
        out(f"{report.folder}/trials.csv")
    err(report.loading)
