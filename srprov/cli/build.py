"""`srprov build`: bring an experiment's images to its robots ahead of `apply`, or show what would be built."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, TextIO

import click
from msgspec.structs import replace

from srprov.cli import fork_options, inputs, options, output_options
from srprov.cli.execute import carry_out, confirm, refuse_without_terminal
from srprov.cli.output import out
from srprov.cli.plan import show_plan
from srprov.cli.stdout_guard import answers_only
from srprov.codes import Code
from srprov.controller.phases import Phases
from srprov.controller.request import PlanRequest
from srprov.errors import UsageError

if TYPE_CHECKING:
    from srprov.controller.fleet import Fleet
    from srprov.controller.plan import Planned
    from srprov.definitions.model import Definitions, Inventory
    from srprov.execution import RunOptions
    from srprov.session import Pulse


@click.command()
@click.argument("file", metavar="FILE")
@click.argument("services", metavar="[SERVICE]...", nargs=-1)
@click.option("--show", is_flag=True, help="Print the Dockerfiles of these services, or of all; no robot is asked.")
@click.option("-i", "--inventory", "inventories", multiple=True, metavar="FILE",
              help="Inventory; may be repeated. Not needed with --show.")  # fmt: skip
@options.JSON
@fork_options.FORKS
@options.TIMEOUT
@options.ASK_BECOME
@options.LIMIT
@options.EXCLUDE
@options.waiting
@options.RUNS
@output_options.TIMINGS
@options.planning
@options.MAX_FAIL
@options.LOCKED
@click.option("-y", "--yes", is_flag=True, help="Do not ask.")
@output_options.EVENTS
@output_options.QUIET
@click.option("-v", "--verbose", is_flag=True, help="Show the exact commands of each step.")
@click.option("--no-color", is_flag=True, help="Plain text; so does NO_COLOR.")
def build(
    file: str, services: tuple[str, ...], show: bool, inventories: tuple[str, ...], as_json: bool, forks: int,
    timeout: float, limit: str, exclude: str, lock_wait: float, pulse: Pulse, runs: Path | None, request: PlanRequest,
    unreachable: str, max_fail: str, locked: bool, yes: bool, events: TextIO | None, verbose: bool, no_color: bool,
) -> int:  # fmt: skip
    """Bring the images of an experiment to its robots, ahead of `apply`: built, pulled or copied as `apply` would.

    With SERVICE names, the images of those alone. Nothing else is made there. Robots are chosen as by `apply`, with the
    same options and permissions. With --show, print what would be built.
    """
    from srprov.controller.source import read_definitions
    from srprov.execution import RunOptions

    if show:
        found = read_definitions(file, request.allowed, request.profiles, locked=locked)
        return _show(found, services, request, inventories, as_json=as_json)
    if not inventories:
        raise UsageError(
            "which robots?", hint="name the inventory with -i, or look at the Dockerfiles with --show", code=Code.WHICH
        )
    refuse_without_terminal(yes)
    phases = Phases()
    definitions = read_definitions(file, request.allowed, request.profiles, locked=locked)
    request = inputs.with_own_files(replace(request, targets=services), definitions.experiment)
    inventory = inputs.load_inventory(inventories)
    name = request.instance or definitions.experiment.name
    chosen = inputs.selected(inventory, limit, exclude, inputs.failed_robots(name, runs))
    failing = options.budget(max_fail, len(chosen))
    with inputs.connect(inventory, timeout, forks, changing=True) as fleet:
        output_options.note(f"asking {len(inventory.hosts)} robots for facts")
        phases.begin("facts")
        lock_wait = inputs.waited(fleet, name, lock_wait, chosen)
        planned = _planned(definitions, fleet, request, phases).limited(chosen)
        if not as_json and not (yes and output_options.is_quiet()):
            show_plan(planned.plan, None, verbose=verbose)
        run_options = _allowed(planned, request, inventory, RunOptions(
            verb="build", forks=forks, lock_wait_s=lock_wait, pulse=pulse, max_fail=failing, settle_s=0.0,
            tolerate=frozenset(planned.plan.unreachable if unreachable != "fail" else ()),
        ))  # fmt: skip
        confirm(planned.plan, yes, run_options.stop_timeout_s)
        phases.begin("apply")
        return carry_out(
            planned, fleet, run_options, phases, as_json=as_json, events=events, color=not no_color, runs=runs
        )


def _show(
    definitions: Definitions, services: tuple[str, ...], request: PlanRequest, inventories: tuple[str, ...], *,
    as_json: bool,
) -> int:  # fmt: skip
    """Print the Dockerfiles of an experiment."""
    from srprov.controller.dockerfiles import dockerfiles
    from srprov.controller.own_files import NO_ROBOTS

    if as_json:
        raise UsageError("--show prints Dockerfiles, not JSON", hint="leave --json out", code=Code.OPTIONS)
    inventory = inputs.load_inventory(inventories) if inventories else NO_ROBOTS
    out("\n\n".join(dockerfiles(definitions, services, request.allowed, inventory)))
    return 0


def _allowed(planned: Planned, request: PlanRequest, inventory: Inventory, run_options: RunOptions) -> RunOptions:
    """Refuse what the user did not allow; return the options with what builds may run."""
    from srprov.controller.permissions import may_trigger, permit_run

    permit_run(planned.plan, request.allowed, inventory, request.policies)
    return replace(run_options, triggers=may_trigger(request.allowed, inventory, request.policies))


def _planned(definitions: Definitions, fleet: Fleet, request: PlanRequest, phases: Phases) -> Planned:
    with fleet.look(definitions.experiment) as look, answers_only():
        from srprov.controller.build_ahead import make_build  # imported while the robots are asked

        return make_build(definitions, look, request, phases)
