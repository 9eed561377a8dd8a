"""`srprov diff`: what a change of an EDF would change, without robots."""

from __future__ import annotations

from pathlib import Path

import click
from msgspec.structs import replace

from srprov.cli import inputs, options
from srprov.cli.codes import DIFFERENCES
from srprov.cli.output import clean, out_whole
from srprov.cli.plan import show_plan
from srprov.cli.stdout_guard import answers_only
from srprov.cli.stored_facts import stored_facts
from srprov.controller.request import PlanRequest


@click.command()
@click.argument("old", metavar="OLD")
@click.argument("new", metavar="NEW")
@options.INVENTORY
@options.JSON
@options.deciding
@options.ALLOW
@click.option(
    "--facts", "stored", type=click.Path(exists=True, dir_okay=False, path_type=Path), required=True, metavar="FILE",
    help="The robots, as `facts --json` wrote them, or the facts.json of a run; none is asked.",
)  # fmt: skip
@click.option("--detailed-exitcode", is_flag=True, help="Exit with 2 when something would change.")
@click.option("--format", "form", type=click.Choice(["text", "json", "markdown"]), default="text", show_default=True)
@click.option("-v", "--verbose", is_flag=True, help="Show steps of plumbing one by one.")
def diff(
    old: str, new: str, inventories: tuple[str, ...], as_json: bool, request: PlanRequest, allow: tuple[str, ...],
    stored: Path, detailed_exitcode: bool, form: str, verbose: bool,
) -> int:  # fmt: skip
    """Show what would change on the robots if the EDF NEW took the place of OLD; no robot is asked.

    Both are planned for robots of which only the facts are known: OLD as if nothing was there, NEW where OLD runs.
    Values of secrets are not read.
    """
    from srprov.cli.permitted import permitted
    from srprov.controller.comparison import compared
    from srprov.controller.source import read_definitions
    from srprov.planning.markdown import plan_markdown
    from srprov.planning.plan import plan_json

    policies, allowed = permitted(allow)
    request = replace(request, allowed=allowed, policies=policies)
    before, after = (read_definitions(file, allowed, request.profiles) for file in (old, new))
    inventory = inputs.load_inventory(inventories)
    snapshot, _ = stored_facts(stored, inventory)
    request = inputs.with_own_files(request, before.experiment)
    with answers_only():
        made = compared(before, after, inventory, snapshot, request)
    if form == "markdown" and not as_json:
        out_whole(plan_markdown(made, commands=verbose, hide=clean).rstrip())
    else:
        show_plan(made, plan_json(made) if as_json or form == "json" else None, verbose=verbose)
    return DIFFERENCES if detailed_exitcode and not made.empty else 0
