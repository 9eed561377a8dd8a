"""`srprov apply`: plan, ask, do, report."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, TextIO

import click

from srprov.cli import inputs, key_options, options, output_options
from srprov.cli.execute import carry_out, confirm, refuse_without_terminal
from srprov.cli.plan import show_plan
from srprov.cli.seconds import Seconds
from srprov.cli.standing import signers_option
from srprov.cli.stdout_guard import answers_only
from srprov.cli.target_options import targeting
from srprov.codes import Code
from srprov.controller.phases import Phases
from srprov.controller.request import PlanRequest
from srprov.definitions.model import Definitions
from srprov.errors import UsageError

if TYPE_CHECKING:
    from srprov.controller.fleet import Fleet
    from srprov.controller.plan import Planned
    from srprov.execution.probing import OverlayProbe
    from srprov.planning.planfile import PlanFile
    from srprov.secret import Vault
    from srprov.session import Pulse


def _expected(_context: click.Context, _option: click.Parameter, text: str) -> str:
    """Refuse what is no hash before a robot is asked."""
    if not text:
        return ""
    from srprov.planning.planhash import expected_hash

    return expected_hash(text)


@click.command()
@click.argument("file", metavar="FILE")
@options.robots
@options.LIMIT
@options.EXCLUDE
@options.locking
@options.RUNS
@output_options.TIMINGS
@options.planning
@key_options.rotating
@targeting
@options.MAX_FAIL
@options.LOCKED
@click.option("-y", "--yes", is_flag=True, help="Do not ask.")
@click.option("--wait-timeout", type=Seconds(min=0), default=300.0, show_default=True, metavar="S",
              help="Seconds for a service to become healthy or to complete.")  # fmt: skip
@click.option("--settle", type=Seconds(min=0), default=2.0, show_default=True, metavar="S",
              help="A service must still run so many seconds after its start.")  # fmt: skip
@click.option("--no-probe", is_flag=True, help="Do not try the overlay after a change on it.")
@signers_option("Only a plan that one of them signed: an allowed_signers file, see ssh-keygen(1).")
@click.option("--expect", default="", metavar="HASH", callback=_expected,
              help="Do only the plan that `srprov plan` showed with this hash; refuse others with 6.")  # fmt: skip
@output_options.EVENTS
@output_options.QUIET
@click.option(
    "-v", "--verbose", is_flag=True, help="Show the exact commands of each step, and steps of plumbing one by one."
)
@click.option("--no-color", is_flag=True, help="Plain text; so does NO_COLOR.")
def apply(
    file: str, inventories: tuple[str, ...], as_json: bool, forks: int, timeout: float, limit: str, exclude: str,
    request: PlanRequest, unreachable: str, yes: bool, wait_timeout: float, settle: float, events: TextIO | None,
    verbose: bool, no_color: bool, lock_wait: float, stop_timeout: float, pulse: Pulse, runs: Path | None,
    max_fail: str, signers: str | None, locked: bool, no_probe: bool, expect: str,
) -> int:  # fmt: skip
    """Change the robots so that the experiment runs on them. FILE is an EDF, or a plan that `srprov plan -o` wrote.

    Shows the plan and asks on a terminal, unless --yes. A second apply changes nothing. After a change on the overlay
    it tries that, as `srprov probe` does, and ends with 3 when it fails. A plan from a file is done exactly as it
    stands there, or refused: with 6 when a robot changed since, with 5 when it was changed itself.
    """
    from srprov.controller.permissions import may_trigger, permit_run
    from srprov.controller.secrets import HeldSecrets
    from srprov.controller.source import read_source
    from srprov.execution import RunOptions

    refuse_without_terminal(yes)
    phases = Phases()
    source = read_source(file, signers or "", request.allowed, request.profiles, locked=locked)
    _check_fits(request, source)
    secrets = HeldSecrets(source, request.allowed)
    inventory = inputs.load_inventory(inventories)
    name = _instance(source, request)
    chosen = inputs.selected(inventory, limit, exclude, inputs.failed_robots(name, runs))
    failing = options.budget(max_fail, len(chosen))
    with inputs.connect(inventory, timeout, forks, changing=True, vault=secrets.vault) as fleet:
        output_options.note(f"asking {len(inventory.hosts)} robots for facts")
        phases.begin("facts")
        lock_wait = inputs.waited(fleet, name, lock_wait, chosen)
        planned = _planned(source, fleet, request, secrets.vault, phases, signed=bool(signers)).limited(chosen)
        if not as_json and not (yes and output_options.is_quiet()):
            show_plan(planned.plan, None, verbose=verbose, color=not no_color)
        _check_expected(planned, expect)
        permit_run(planned.plan, request.allowed, inventory, request.policies)
        confirm(planned.plan, yes, stop_timeout)
        planned = secrets.read(planned)
        phases.begin("apply")
        how = RunOptions(
            forks=forks, wait_timeout_s=wait_timeout, stop_timeout_s=stop_timeout, settle_s=settle,
            lock_wait_s=lock_wait, pulse=pulse, max_fail=failing, probing=None if no_probe else _probing(planned),
            triggers=may_trigger(request.allowed, inventory, request.policies),
            tolerate=frozenset(planned.plan.unreachable if unreachable != "fail" else ()),
        )  # fmt: skip
        return carry_out(planned, fleet, how, phases, as_json=as_json, events=events, color=not no_color, runs=runs)


def _check_expected(planned: Planned, expected: str) -> None:
    """Refuse another plan than the one that somebody reviewed."""
    if expected:
        from srprov.planning.planhash import check_hash

        check_hash(planned.plan, expected)


def _get_ready() -> None:
    """Import what does the plan, while it is still being made."""
    from srprov.controller import probe  # noqa: F401 - to have it imported
    from srprov.controller.run import get_ready

    get_ready()


def _probing(planned: Planned) -> OverlayProbe | None:
    """Return what to try after the run, when it will change anything."""
    if planned.plan.empty:
        return None
    from srprov.controller.probe import probing_of

    return probing_of(planned)


def _check_fits(request: PlanRequest, source: Definitions | PlanFile) -> None:
    """Refuse a request that asks of a plan from a file what was decided when that was made."""
    if isinstance(source, Definitions):
        return
    decided = (request.instance, request.reassign, request.history, request.reassign_unreachable, request.data,
               request.copy, request.rotate_keys, request.profiles, request.targets)  # fmt: skip
    if any(decided):
        raise UsageError(
            "--instance, --profile, --target, --reassign, --history, --data, --copy, --rotate-keys and "
            "--unreachable=reassign are decided when a plan is made, not when it is applied",
            code=Code.OPTIONS,
        )


def _instance(source: Definitions | PlanFile, request: PlanRequest) -> str:
    if isinstance(source, Definitions):
        return request.instance or source.experiment.name
    return source.plan.instance


def _planned(
    source: Definitions | PlanFile, fleet: Fleet, request: PlanRequest, vault: Vault, phases: Phases, *, signed: bool
) -> Planned:
    """Make the plan, or check that the one from a file still holds."""
    if not isinstance(source, Definitions):
        from srprov.controller.saved import check_plan

        return check_plan(source, fleet, adopt=request.adopt, signed=signed)
    with fleet.look(source.experiment, meanwhile=_get_ready) as look, answers_only():
        from srprov.controller.plan import make_plan  # a tenth of a second of imports, while the robots are asked
        from srprov.controller.targets import only_targets

        request = inputs.with_own_files(request, source.experiment)
        return only_targets(make_plan(source, look, request, vault, phases), request.targets)
