"""`srprov replay`: a bundle's trials again, on other robots, and what is the same."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

import click
from msgspec.structs import replace

from srprov.cli import inputs, options, output_options
from srprov.cli.compare import MARGINS, STRICT, margins_of, show_comparison
from srprov.cli.execute import refuse_without_terminal
from srprov.cli.output import err
from srprov.cli.seconds import Seconds
from srprov.cli.trial_session import Manner, check_wanted, run_session, show_report
from srprov.controller.request import PlanRequest
from srprov.errors import UsageError

if TYPE_CHECKING:
    from srprov.facts.model import Snapshot
    from srprov.session import Pulse


@click.command()
@click.argument("bundle", metavar="BUNDLE", type=click.Path(exists=True, dir_okay=False))
@options.robots
@options.locking
@options.planning
@click.option("-o", "--out", "target", type=click.Path(file_okay=False, path_type=Path), required=True, metavar="DIR",
              help="A new folder: the bundle's definitions go to DIR/experiment, the run to DIR/run.")  # fmt: skip
@click.option("--map", "pairs", multiple=True, metavar="OLD=NEW",
              help="NEW of the inventory does the part of OLD in the bundle; may be repeated. Others keep their "
              "names.")  # fmt: skip
@click.option("--only", multiple=True, metavar="TRIAL|POINT", help="Only this trial, or trials of this point.")
@MARGINS
@STRICT
@click.option("--signers", type=click.Path(exists=True, dir_okay=False), default=None, metavar="FILE",
              help="Only a bundle that somebody signed whom this allowed_signers file names.")  # fmt: skip
@click.option("-y", "--yes", is_flag=True, help="Do not ask.")
@click.option("--wait-timeout", type=Seconds(min=0), default=300.0, show_default=True, metavar="S",
              help="Seconds for a service that is kept over all trials to become healthy.")  # fmt: skip
@output_options.EVENTS
@output_options.QUIET
@click.option("--no-color", is_flag=True, help="Plain text; so does NO_COLOR.")
def replay(
    bundle: str, inventories: tuple[str, ...], as_json: bool, forks: int, timeout: float, request: PlanRequest,
    unreachable: str, lock_wait: float, stop_timeout: float, pulse: Pulse, target: Path, pairs: tuple[str, ...],
    only: tuple[str, ...], margins: tuple[str, ...], strict: bool, signers: str | None, yes: bool,
    wait_timeout: float, events: TextIO | None, no_color: bool,
) -> int:  # fmt: skip
    """Run the trials of a bundle again, on robots of yours, and compare what comes of it.

    The bundle is verified first. The same trials with the same seeds in the same order, services on the robots that
    do the parts of their old ones. What the experiment asks for needs --allow, as that of any file of a stranger.
    """
    from srprov.controller.source import read_definitions
    from srprov.controller.trial_request import TrialsRequest
    from srprov.evidence import replay as evidence

    refuse_without_terminal(yes)
    if unreachable != "fail":
        raise UsageError("trials need all their robots", hint="leave --unreachable out")
    asked, judged_by = dict(map(_pair, pairs)), margins_of(margins)
    inventory = inputs.load_inventory(inventories)
    output_options.note(f"verifying {bundle}")
    evidence.check(bundle, signers or "")
    again = evidence.read(bundle)
    inventory = evidence.mapped(inventory, again.robots, asked)
    evidence.unpack(bundle, target / "experiment")
    request = replace(request, placed=again.placed)
    definitions = read_definitions(str(target / "experiment" / again.edf), request.allowed, request.profiles)

    def robots(snapshot: Snapshot) -> Iterator[str]:
        yield "\nWho does whose part:\n"
        yield from evidence.differences(again, asked, snapshot)

    manner = Manner(
        forks=forks, timeout=timeout, lock_wait=lock_wait, stop_timeout=stop_timeout, wait_timeout=wait_timeout,
        pulse=pulse, events=events, color=not no_color, as_json=as_json, yes=yes,
    )  # fmt: skip
    wanted = TrialsRequest(folder=target / "run", only=only)
    check_wanted(definitions, wanted)
    report = run_session(definitions, inventory, request, wanted, manner, robots)
    if report.exit_code:
        show_report(report, as_json=False)
        err(f"not compared with {bundle}, as it is not whole")
        return report.exit_code
    return show_comparison([bundle], [str(target / "run")], judged_by, strict=strict, as_json=as_json)


def _pair(text: str) -> tuple[str, str]:
    """Read OLD=NEW."""
    old, _, new = text.partition("=")
    if not old or not new:
        raise UsageError(f"--map {text} is none", hint="for example --map robot1=kuka3")
    return old, new
