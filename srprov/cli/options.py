"""Options that several verbs share, and the requests that they make."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar, cast

import click
from msgspec.structs import replace

from srprov import names
from srprov.cli.fork_options import FORKS, SHARING
from srprov.cli.output_options import no_way_out
from srprov.cli.seconds import Seconds
from srprov.codes import Code
from srprov.controller.request import SEARCH_LIMIT_S, PlanRequest
from srprov.errors import UsageError
from srprov.session import Pulse

_F = TypeVar("_F", bound=Callable[..., Any])

INVENTORY = click.option(
    "-i", "--inventory", "inventories", multiple=True, required=True, metavar="FILE", help="Inventory; may be repeated."
)


def _instance(_context: click.Context, _option: click.Parameter, name: str) -> str:
    """Hold --instance to the rule for names: it becomes folders, here and on robots."""
    return names.checked("instance", name, hint="name it as an EDF would, e.g. --instance trial-2") if name else ""


INSTANCE = click.option(
    "--instance", default="", metavar="ID", callback=_instance, help="Instance id (default: the experiment's name)."
)
JSON = click.option("--json", "as_json", is_flag=True, help="One JSON document on stdout, all else on stderr.")
TIMEOUT = click.option(
    "--timeout", type=Seconds(min=0.1), default=10.0, show_default=True, metavar="S",
    help="Seconds to connect to a robot.",
)  # fmt: skip
LIMIT = click.option(
    "--limit",
    default="",
    metavar="PATTERN",
    help="Change only these robots (Ansible pattern; @failed: those that the last run did not finish; @FILE: a list).",
)
EXCLUDE = click.option("--exclude", default="", metavar="PATTERN", help="Do not change these robots.")


def _pulse(_context: click.Context, _option: click.Parameter, text: str) -> Pulse:
    """Read `BEAT,CONTROLLER,ROBOT`, seconds each; empty is the default."""
    try:
        beat, controller, robot = text.split(",") if text else ("5", "20", "30")
        return Pulse(beat_s=float(beat), controller_s=float(controller), robot_s=int(robot))
    except ValueError as error:
        raise click.BadParameter(f"{text!r}: {error}; three numbers are wanted, e.g. 1,4,6") from None


def waiting(function: _F) -> _F:
    """Add the options of every verb that locks robots."""
    wait = click.option("--lock-wait", type=Seconds(min=0), default=0.0, show_default=True, metavar="S",
                        help="Seconds to wait for robots that somebody else is changing.")  # fmt: skip
    heartbeat = click.option(
        "--heartbeat", "pulse", envvar="SRPROV_HEARTBEAT", default="", callback=_pulse, hidden=True
    )
    return wait(heartbeat(function))


def locking(function: _F) -> _F:
    """Add the options of every verb that stops services."""
    stop = click.option("--stop-timeout", type=click.FloatRange(min=0, max=86_400), default=60.0, show_default=True,
                        metavar="S", help="Kill a service that has not stopped after so many seconds, "
                        "even if its own stop_grace_period is longer.")  # fmt: skip
    return waiting(stop(function))


def _ask_become(context: click.Context, _option: click.Parameter, wanted: bool) -> None:
    """Leave the wish where `load_inventory` finds it: every verb that reads an inventory has it, none handles it."""
    context.meta[_ASK_BECOME] = wanted


_ASK_BECOME = "srprov.ask-become-pass"
ASK_BECOME = click.option(
    "-K", "--ask-become-pass", is_flag=True, expose_value=False, callback=_ask_become,
    help="Ask for sudo's password, for robots without ansible_become_password.",
)  # fmt: skip


def asked_for_become() -> bool:
    """Return whether the user wants to be asked for sudo's password."""
    context = click.get_current_context(silent=True)
    return bool(context and context.meta.get(_ASK_BECOME))


RUNS = click.option(
    "--runs", type=click.Path(file_okay=False, path_type=Path), envvar="SRPROV_RUNS", default=None, metavar="DIR",
    callback=no_way_out, help="Where runs are recorded (default: ~/.local/state/srprov/runs).",
)  # fmt: skip


_UNREACHABLE = click.option(
    "--unreachable",
    type=click.Choice(["fail", "skip", "reassign"]),
    default="fail",
    show_default=True,
    help="When robots cannot be reached: do the others and exit with 4, or with 0 (skip), "
    "or place their services elsewhere (reassign).",
)
ALLOW = click.option(
    "--allow",
    multiple=True,
    metavar="KIND",
    help="Allow what the plan lists as asked for, e.g. host-network or playbook; or all.",
)
PROFILES = click.option(
    "--profile", "profiles", multiple=True, metavar="NAME",
    help="Also the services with this profile, may be repeated; '*' for all. Without it, those that have none.",
)  # fmt: skip
_HISTORY = click.option(
    "--history", type=click.Path(exists=True, file_okay=False, path_type=Path), default=None, metavar="DIR",
    help="Earlier runs (DIR/*/assignment.json): fairness evens out what robots carried in them.",
)  # fmt: skip
_REASSIGN = click.option("--reassign", is_flag=True, help="Let running services move when that is cheaper.")
_ADOPT = click.option(
    "--adopt", is_flag=True, help="Take over what another file made, or only robots know; believe a new plan file."
)
_DATA = click.option(
    "--data", type=click.Choice(["move", "leave"]), default=None,
    help="When a service goes to another robot than its data is on: copy the data there and remove it here once the "
    "copy was compared (move), or start without it (leave). Without this it stays, with its service.",
)  # fmt: skip
_COPY = click.option(
    "--copy", type=click.Choice(["thin", "registry", "whole"]), default=None,
    help="How an image gets from one robot to another: without the layers that are there (thin), pulled by its engine "
    "(registry), or whole. Without this, as the engine's store has it; see docs/images.md.",
)  # fmt: skip
_SEARCH_LIMIT = click.option(
    "--time-limit", type=Seconds(min=0, min_open=True), default=SEARCH_LIMIT_S, show_default=True, metavar="S",
    help="Stop each search after so long, with the best found, and say so; an answer takes up to three.",
)  # fmt: skip


def deciding(function: _F) -> _F:
    """Add the options that say how robots are chosen; the verb gets `request`."""

    @functools.wraps(function)
    def with_request(
        *, instance: str, profiles: tuple[str, ...], reassign: bool, history: Path | None, time_limit: float,
        **more: object,
    ) -> object:  # fmt: skip
        runs: tuple[Mapping[str, float], ...] = ()
        if history:
            from srprov.controller.history import read_history

            runs = read_history(history)
        request = PlanRequest(
            instance=instance, profiles=profiles, reassign=reassign, history=runs, search_limit_s=time_limit
        )
        return function(request=request, **more)

    return cast("_F", INSTANCE(PROFILES(_HISTORY(_REASSIGN(_SEARCH_LIMIT(with_request))))))


def planning(function: _F) -> _F:
    """Add the options that say how a plan is made; the verb gets `request`, and `unreachable` as the user wrote it."""

    @functools.wraps(function)
    def with_request(
        *, request: PlanRequest, adopt: bool, unreachable: str, allow: tuple[str, ...], data: str | None,
        copy: str | None, **more: object,
    ) -> object:  # fmt: skip
        from srprov.cli.permitted import permitted

        policies, allowed = permitted(allow)
        request = replace(
            request,
            adopt=adopt,
            reassign_unreachable=unreachable == "reassign",
            allowed=allowed,
            policies=policies,
            data=data or "",
            copy=copy or "",
        )
        return function(request=request, unreachable=unreachable, **more)

    return cast("_F", deciding(_ADOPT(_UNREACHABLE(ALLOW(_DATA(_COPY(with_request)))))))


LOCKED = click.option(
    "--locked", is_flag=True, help="Refuse an EDF without a lock, or whose lock is out of date; see `srprov lock`."
)
MAX_FAIL = click.option(
    "--max-fail",
    default="",
    metavar="N|N%",
    help="Begin no further step when steps failed on more robots than this.",
)


def budget(text: str, robots: int) -> int | None:
    """Read `--max-fail`: a number of robots, or a share of `robots`, rounded down.

    Raises:
        UsageError: It is neither.
    """
    if not text:
        return None
    if not (number := text.removesuffix("%")).isdecimal() or (text.endswith("%") and int(number) > 100):
        wrong = f"--max-fail takes a number of robots or a share, not '{text}'"
        raise UsageError(wrong, hint="e.g. 1 or 25%", code=Code.OPTION_VALUE)
    return int(number) * robots // 100 if text.endswith("%") else int(number)


def quietly_robots(function: _F) -> _F:
    """Add the options of a verb that streams text from robots: no JSON, and `-f` is left for --follow."""
    forks = click.option(
        "--forks", type=click.IntRange(min=1), default=64, show_default=True, help="Robots at the same time."
    )
    for option in (ASK_BECOME, TIMEOUT, SHARING, forks, INVENTORY):
        function = option(function)
    return function


def robots_without_json(function: _F) -> _F:
    """Add the options of a verb that talks to robots and whose answer is a file."""
    for option in (ASK_BECOME, TIMEOUT, FORKS, INVENTORY):
        function = option(function)
    return function


def chosen(function: _F) -> _F:
    """Add the options of a verb that looks at some of the robots."""
    only = "Only these robots (Ansible pattern; @FILE: a list)."
    limit = click.option("--limit", default="", metavar="PATTERN", help=only)
    exclude = click.option("--exclude", default="", metavar="PATTERN", help="Not these robots.")
    return limit(exclude(function))


def robots_anywhere(function: _F) -> _F:
    """Add the options of every verb that talks to robots, but for which robots those are."""
    for option in (ASK_BECOME, TIMEOUT, FORKS, JSON):
        function = option(function)
    return function


def robots(function: _F) -> _F:
    """Add the options of every verb that talks to robots."""
    return INVENTORY(robots_anywhere(function))
