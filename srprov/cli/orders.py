"""What `stop`, `start` and `restart` share: options, the plan, the question, and the run."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO, TypeVar

import click

from srprov.cli import inputs, options, output_options
from srprov.cli.execute import carry_out, confirm, refuse_without_terminal
from srprov.cli.plan import show_plan
from srprov.cli.seconds import Seconds
from srprov.codes import Code
from srprov.controller.phases import Phases
from srprov.errors import RefusedError, UsageError, did_you_mean
from srprov.session import Pulse

if TYPE_CHECKING:
    from srprov.controller.fleet import Fleet
    from srprov.controller.plan import Planned

_SETTLE_S = 2.0
"""A service must still run so long after its start."""
_F = TypeVar("_F", bound=Callable[..., Any])


def order_options(function: _F) -> _F:
    """Add the options of all three verbs."""
    wait = click.option("--wait-timeout", type=Seconds(min=0), default=300.0, show_default=True, metavar="S",
                        help="Seconds for what a service depends on to become healthy or to complete.")  # fmt: skip
    yes = click.option("-y", "--yes", is_flag=True, help="Do not ask.")
    adopt = click.option("--adopt", is_flag=True, help="Also when another file made the instance.")
    color = click.option("--no-color", is_flag=True, help="Plain text; so does NO_COLOR.")
    for option in (color, output_options.QUIET, output_options.EVENTS, adopt, yes, wait, options.RUNS, options.locking,
                   options.INSTANCE, options.robots):  # fmt: skip
        function = option(function)
    return function


def give_order(
    verb: str, file: str, services: tuple[str, ...], *, inventories: tuple[str, ...], as_json: bool, forks: int,
    timeout: float, instance: str, lock_wait: float, stop_timeout: float, pulse: Pulse, runs: Path | None,
    wait_timeout: float, yes: bool, adopt: bool, events: TextIO | None, no_color: bool,
) -> int:  # fmt: skip
    """Stop or start services, and return the exit code."""
    _refuse_without_terminal(file, services, yes=yes)
    phases = Phases()
    inventory = inputs.load_inventory(inventories)
    name, source = inputs.named_instance(file, instance)
    with inputs.connect(inventory, timeout, forks, changing=True) as fleet:
        phases.begin("facts")
        lock_wait = inputs.waited(fleet, name, lock_wait, frozenset(inventory.hosts))
        planned = _planned(fleet, verb, file, services, name, source, adopt=adopt)
        if not as_json and not (yes and output_options.is_quiet()):
            show_plan(planned.plan, None, verbose=False)
        confirm(planned.plan, yes, stop_timeout)
        phases.begin(verb)
        from srprov.execution import RunOptions

        run_options = RunOptions(
            forks=forks, verb=verb, stop_timeout_s=stop_timeout, wait_timeout_s=wait_timeout, lock_wait_s=lock_wait,
            pulse=pulse, settle_s=0.0 if verb == "stop" else _SETTLE_S,
        )  # fmt: skip
        return carry_out(
            planned, fleet, run_options, phases, as_json=as_json, events=events, color=not no_color, runs=runs
        )


def _refuse_without_terminal(file: str, services: tuple[str, ...], *, yes: bool) -> None:
    """Refuse a question that nobody can answer; a name that the EDF alone shows to be misspelt is told instead."""
    try:
        refuse_without_terminal(yes)
    except RefusedError:
        known = getattr(inputs.experiment_if_valid(file), "services", {})
        for word in services:
            name = word.partition("@")[0]
            replica = any(name.startswith(f"{one}-") for one in known)
            if name not in known and not replica and (near := did_you_mean(name, known)):
                said = f"the experiment has no service '{name}'"
                raise UsageError(said, hint=near, code=Code.NO_SUCH_NAME) from None
        raise


def _planned(
    fleet: Fleet, verb: str, file: str, services: tuple[str, ...], name: str, source: str, *, adopt: bool
) -> Planned:
    from srprov.controller.located import locate
    from srprov.controller.orders import Order, make_order
    from srprov.controller.ownership import check_source, looking
    from srprov.facts.gather import Detail

    experiment = inputs.experiment_if_valid(file)
    snapshot = fleet.gather(Detail.BASIC)
    check_source(looking(snapshot, name).snapshot, name, source, adopt=adopt)
    there = locate(snapshot, name, experiment)
    return make_order(Order(verb=verb, words=services), there, snapshot, there.by_name)
