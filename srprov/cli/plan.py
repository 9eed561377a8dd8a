"""`srprov plan`: what would change, and never changing it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from srprov.cli import options
from srprov.cli.history import HISTORY, read_history
from srprov.cli.output import err, out, out_json
from srprov.cli.output_options import writable
from srprov.cli.stdout_guard import answers_only
from srprov.errors import RefusedError, UsageError
from srprov.secret import Vault, redact

if TYPE_CHECKING:
    from srprov.planning.plan import Plan
    from srprov.planning.planfile import PlanFile

DIFFERENCES = 2
UNREACHABLE = 4


@click.command()
@click.argument("file", metavar="FILE")
@options.robots
@options.INSTANCE
@options.LIMIT
@options.EXCLUDE
@options.RUNS
@HISTORY
@click.option("--reassign", is_flag=True, help="Let running services move when that is cheaper.")
@click.option("--adopt", is_flag=True, help="Take over an instance that another file made.")
@options.UNREACHABLE
@options.ALLOW
@click.option("--detailed-exitcode", is_flag=True, help="Exit with 2 when something would change.")
@click.option("--format", "form", type=click.Choice(["text", "json", "markdown"]), default="text", show_default=True)
@click.option(
    "-o",
    "--out",
    "target",
    type=click.Path(dir_okay=False),
    callback=writable,
    metavar="FILE",
    help="Also write the plan to a file that `apply` takes.",
)
@click.option("-v", "--verbose", is_flag=True, help="Show the exact commands of each step.")
def plan(
    file: str, inventories: tuple[str, ...], as_json: bool, forks: int, timeout: float, instance: str, limit: str,
    exclude: str, reassign: bool, adopt: bool, detailed_exitcode: bool, form: str, target: str | None, verbose: bool,
    history: Path | None, unreachable: str, allow: tuple[str, ...], runs: Path | None,
) -> int:  # fmt: skip
    """Show what would change; changes nothing.

    Playbooks in ~/.config/srprov/playbooks replace srprov's own by name, or add to them; the plan names them.

    Exits with 0; with 2 when --detailed-exitcode is given and something would change; with 4 when a robot cannot be
    reached, unless --unreachable says otherwise.
    """
    from srprov.cli.apply import check_kinds, own_playbooks, read_secrets

    definitions = options.load_experiment(file)
    check_kinds(allow)
    vault = read_secrets(None, definitions, allow)
    inventory = options.load_inventory(inventories)
    last = options.failed_robots(instance or definitions.experiment.name, runs)
    chosen = options.selected(inventory, limit, exclude, last)
    before, own = read_history(history), own_playbooks()
    with options.open_lab(inventory, timeout, forks) as lab, answers_only():
        from srprov.facts.gather import begin

        with closing(begin(inventory, lab.sessions.get, definitions.experiment, exact=True, forks=forks)) as looking:
            # a tenth of a second of imports, while the robots are asked
            from srprov.controller import PlanRequest, make_plan
            from srprov.planning.limit import limited
            from srprov.planning.markdown import plan_markdown
            from srprov.planning.plan import plan_json
            from srprov.saved import to_file

            wishes = PlanRequest(
                instance=instance, reassign=reassign, adopt=adopt, forks=forks, history=before, looking=looking,
                reassign_unreachable=unreachable == "reassign", allow=frozenset(allow), playbooks=own, exact=True,
            )  # fmt: skip
            planned = make_plan(definitions, inventory, lab.sessions.get, wishes, vault=vault)
    made = limited(planned.plan, chosen)
    if target:
        write_plan(target, to_file(planned, made, definitions), vault)
    if form == "markdown" and not as_json:
        out(plan_markdown(made).rstrip())
    else:
        show_plan(made, plan_json(made) if as_json or form == "json" else None, verbose=verbose)
    if made.unreachable and unreachable == "fail":
        return UNREACHABLE
    return DIFFERENCES if detailed_exitcode and not made.empty else 0


def write_plan(target: str, file: PlanFile, vault: Vault) -> None:
    """Write a plan file. It is done as it stands there, so a secret in it cannot be replaced, only refused.

    Raises:
        UsageError: The file cannot be written.
        RefusedError: The value of a secret stands in what the plan does: in another field of the user's files.
    """
    from srprov.planning.planfile import dump

    text = dump(dataclasses.replace(file, inputs={name: redact(text) for name, text in file.inputs.items()}))
    if name := vault.holds(text):
        hint = f"take it out of the definition files, or give '{name}' a value that is not an everyday word"
        raise RefusedError(
            f"the value of the secret '{name}' stands in the plan itself; no file was written", hint=hint
        )
    try:
        Path(target).write_text(text, encoding="utf-8")
    except OSError as error:
        raise UsageError(f"cannot write {target}: {error.strerror}", hint="name another file") from error


def show_plan(made: Plan, as_json: Mapping[str, Any] | None, *, verbose: bool) -> None:
    """Print a plan as text, or as JSON with a one-line summary beside it."""
    from srprov.planning.text import plan_text, summary

    if as_json is None:
        out(plan_text(made, commands=verbose).rstrip())
    else:
        out_json(as_json)
        err(summary(made))
