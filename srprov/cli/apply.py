"""`srprov apply`: plan, ask, do, report."""

from __future__ import annotations

import dataclasses
import os
import sys
import time
from collections.abc import Collection, Mapping
from contextlib import ExitStack, closing
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

import click

from srprov.cli import options, output_options
from srprov.cli.config import user_folder
from srprov.cli.execute import Task, carry_out, confirm
from srprov.cli.history import HISTORY, read_history
from srprov.cli.plan import show_plan
from srprov.cli.stdout_guard import answers_only
from srprov.cli.waiting import wait_for_other_runs
from srprov.errors import RefusedError, UsageError
from srprov.secret import Vault

if TYPE_CHECKING:
    from srprov.controller import PlanRequest
    from srprov.definitions.model import Definitions
    from srprov.definitions.playbookmodel import Playbook
    from srprov.planning.planfile import PlanFile
    from srprov.wire import Pulse


@click.command()
@click.argument("file", metavar="FILE")
@options.robots
@options.INSTANCE
@options.LIMIT
@options.EXCLUDE
@options.locking
@options.RUNS
@output_options.TIMINGS
@HISTORY
@options.UNREACHABLE
@options.MAX_FAIL
@click.option("-y", "--yes", is_flag=True, help="Do not ask.")
@options.ALLOW
@click.option("--reassign", is_flag=True, help="Let running services move when that is cheaper.")
@click.option("--adopt", is_flag=True, help="Take over an instance that another file made.")
@click.option("--wait-timeout", type=click.FloatRange(min=0), default=300.0, show_default=True, metavar="S",
              help="Seconds for a service to become healthy or to complete.")  # fmt: skip
@click.option("--settle", type=click.FloatRange(min=0), default=2.0, show_default=True, metavar="S",
              help="A service must still run so many seconds after its start.")  # fmt: skip
@output_options.EVENTS
@output_options.QUIET
@click.option("-v", "--verbose", is_flag=True, help="Show the exact commands of each step.")
@click.option("--no-color", is_flag=True, help="Plain text; so does NO_COLOR.")
def apply(
    file: str, inventories: tuple[str, ...], as_json: bool, forks: int, timeout: float, instance: str, limit: str,
    exclude: str, yes: bool, allow: tuple[str, ...], reassign: bool, adopt: bool, wait_timeout: float, settle: float,
    events: TextIO | None, verbose: bool, no_color: bool, lock_wait: float, pulse: Pulse,
    runs: Path | None, history: Path | None, unreachable: str, max_fail: str,
) -> int:  # fmt: skip
    """Make the experiment true: FILE is an EDF, or a plan that `srprov plan -o` wrote.

    Shows the plan and asks on a terminal, unless --yes. A second apply changes nothing. A plan from a file is done
    exactly as it stands there, or refused with 6 when a robot changed since.
    """
    refuse_without_terminal(yes)
    check_kinds(allow)
    phases = Phases()
    saved = saved_plan(file)
    if saved and (instance or reassign or adopt or history or unreachable == "reassign"):
        raise UsageError(
            "--instance, --reassign, --adopt, --history and --unreachable=reassign are decided when a plan is made, "
            "not when it is applied"
        )
    definitions = None if saved else options.load_experiment(file)
    vault = read_secrets(saved, definitions, allow)
    inventory = options.load_inventory(inventories)
    name = saved.plan.instance if saved else instance or (definitions.experiment.name if definitions else "")
    chosen = options.selected(inventory, limit, exclude, options.failed_robots(name, runs))
    before, own = read_history(history), own_playbooks(saved)
    failing = options.budget(max_fail, len(chosen))
    with options.open_lab(inventory, timeout, forks, locks=True, vault=vault) as lab, ExitStack() as ending:
        from srprov.facts.gather import begin

        output_options.note(f"asking {len(inventory.hosts)} robots for facts")
        lock_wait = wait_for_other_runs(lab, name, lock_wait, forks)
        looking = None
        if definitions:
            looking = ending.enter_context(
                closing(begin(inventory, lab.sessions.get, definitions.experiment, forks=forks))
            )
        # a tenth of a second of imports, while the robots are asked
        from srprov.controller import PlanRequest
        from srprov.execution import RunOptions
        from srprov.planning.policy import require

        wishes = PlanRequest(
            instance=instance, reassign=reassign, adopt=adopt, forks=forks, history=before,
            reassign_unreachable=unreachable == "reassign", allow=frozenset(allow), playbooks=own,
            looking=looking, expect=lambda robots: get_ready(lab, robots & chosen),
        )  # fmt: skip
        task = plan_task(saved, definitions, lab, wishes, phases, vault, chosen)
        made = task.plan
        if not as_json and not (yes and output_options.is_quiet()):
            show_plan(made, None, verbose=verbose)
        require(made.permissions, allow)
        confirm(made, yes)
        phases.begin("apply")
        run_options = RunOptions(
            forks=forks, wait_timeout_s=wait_timeout, settle_s=settle, lock_wait_s=lock_wait, pulse=pulse,
            max_fail=failing, tolerate=frozenset(made.unreachable if unreachable != "fail" else ()),
        )  # fmt: skip
        return carry_out(task, lab, run_options, phases, as_json=as_json, events=events, color=not no_color, runs=runs)


def get_ready(lab: options.Lab, robots: Collection[str]) -> None:
    """Begin to import what changes robots, and to start on these what only a change needs."""
    from srprov.transport import prefetch

    prefetch()
    lab.sessions.prepare(sorted(robots))
    import srprov.execution.executor

    del srprov


def read_secrets(saved: PlanFile | None, definitions: Definitions | None, allow: tuple[str, ...]) -> Vault:
    """Read the values that the run will write, before anything else is started that could inherit a variable.

    Raises:
        RefusedError: The user did not allow it: an EDF could name any variable, file or program of the controller.
    """
    from srprov.definitions.secretvalues import resolve, used
    from srprov.planning.policy import ASKED_FIRST, permissions, require

    if definitions is not None and definitions.unsupported:
        return Vault()
    asked = permissions(definitions.experiment) if definitions else saved.plan.permissions if saved else ()
    require([one for one in asked if one.kind in ASKED_FIRST], allow)
    if saved:
        from srprov.saved import needed

        return resolve(needed(saved))
    assert definitions is not None
    return resolve(used(definitions.experiment))


def plan_task(
    saved: PlanFile | None, definitions: Definitions | None, lab: options.Lab, request: PlanRequest, phases: Phases,
    vault: Vault, chosen: frozenset[str],
) -> Task:  # fmt: skip
    """Make the plan, or check that the one from a file still holds; either without the robots that were not chosen."""
    from srprov.controller import make_plan
    from srprov.planning.limit import limited
    from srprov.saved import check_file, to_file

    if saved:
        phases.begin("facts")
        kept = limited(check_file(saved, lab.inventory, lab.sessions.get, forks=request.forks, vault=vault), chosen)
        return Task(plan=kept, file=lambda: dataclasses.replace(saved, plan=kept))
    assert definitions is not None
    with answers_only():
        planned = make_plan(definitions, lab.inventory, lab.sessions.get, request, phases.begin, vault)
    made = limited(planned.plan, chosen)
    return Task(
        plan=made,
        file=lambda: to_file(planned, made, definitions),
        snapshot=planned.snapshot,
        assignment=planned.assignment,
        desired=planned.desired,
        images=planned.images,
    )


class Phases:
    """Seconds per phase, from one clock."""

    def __init__(self) -> None:
        """Begin with what happens before the first named phase."""
        self.begun = self._last = time.monotonic()
        self._name = "definitions"
        self.seconds: dict[str, float] = {}

    def begin(self, name: str) -> None:
        """End the current phase and begin the next."""
        now = time.monotonic()
        self.seconds[self._name] = self.seconds.get(self._name, 0.0) + now - self._last
        self._name, self._last = name, now

    def end(self) -> Mapping[str, float]:
        """Return seconds per phase, in order."""
        self.begin("end")
        return {name: round(seconds, 3) for name, seconds in self.seconds.items()}

    @property
    def total(self) -> float:
        """Seconds since the beginning."""
        return time.monotonic() - self.begun


def saved_plan(file: str) -> PlanFile | None:
    """Return the plan that a file holds, or None when it is an EDF."""
    try:
        text = Path(file).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return None  # the definitions say what is wrong with it
    if not text.lstrip().startswith("{"):
        return None
    from srprov.planning.planfile import is_plan, load

    return load(text, file) if is_plan(text) else None


def own_playbooks(saved: object = None) -> tuple[Playbook, ...]:
    """Return the playbooks of the user's own folder; a plan from a file was made with those of its time.

    Raises:
        DefinitionError: With everything that is wrong with them.
    """
    folder = user_folder(os.environ) / "playbooks"
    if saved or not folder.is_dir():
        return ()
    from srprov.controller import playbooks
    from srprov.definitions.playbook import from_folder

    return from_folder(str(folder), playbooks())


def refuse_without_terminal(yes: bool) -> None:
    """A question that nobody can answer is refused before anything is done."""
    if not yes and not sys.stdin.isatty():
        raise RefusedError("there is no terminal to ask on", hint="add --yes to go on without being asked")


def check_kinds(allow: tuple[str, ...]) -> None:
    """Refuse a kind that does not exist: a typing mistake must not look like a permission."""
    from srprov.planning.policy import KINDS

    unknown = sorted(set(allow) - {*KINDS, "all"})
    if unknown:
        raise UsageError(f"--allow knows no kind {', '.join(unknown)}", hint=f"known: {', '.join(KINDS)}, all")
