"""`srprov plan`: what would change, and never changing it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from msgspec.structs import replace

from srprov import private
from srprov.cli import inputs, key_options, options
from srprov.cli.codes import DIFFERENCES, UNREACHABLE
from srprov.cli.output import clean, err_whole, out_json_whole, out_whole
from srprov.cli.output_options import written
from srprov.cli.stdout_guard import answers_only
from srprov.cli.target_options import shown_part, targeting
from srprov.codes import Code
from srprov.controller.request import PlanRequest
from srprov.errors import RefusedError, UsageError
from srprov.secret import Vault, redact, redacted

if TYPE_CHECKING:
    from srprov.planning.plan import Plan
    from srprov.planning.planfile import PlanFile


@click.command()
@click.argument("file", metavar="FILE")
@options.robots
@shown_part
@options.RUNS
@options.planning
@key_options.rotating
@targeting
@options.LOCKED
@click.option("--detailed-exitcode", is_flag=True, help="Exit with 2 when something would change.")
@click.option("--format", "form", type=click.Choice(["text", "json", "markdown"]), default="text", show_default=True)
@click.option(
    "-o", "--out", "target", type=click.Path(dir_okay=False), callback=written, metavar="FILE",
    help="Also write the plan to a file that `apply` takes.",
)  # fmt: skip
@click.option(
    "--sign", type=click.Path(exists=True, dir_okay=False), default=None, metavar="KEY",
    help="Sign the plan with this SSH key, into FILE.sig, for `apply --signers`.",
)  # fmt: skip
@click.option(
    "-v", "--verbose", is_flag=True, help="Show the exact commands of each step, and steps of plumbing one by one."
)
def plan(
    file: str, inventories: tuple[str, ...], as_json: bool, forks: int, timeout: float, limit: str, exclude: str,
    runs: Path | None, request: PlanRequest, unreachable: str, detailed_exitcode: bool, form: str, target: str | None,
    verbose: bool, sign: str | None, locked: bool,
) -> int:  # fmt: skip
    """Show what would change; changes nothing.

    Playbooks in ~/.config/srprov/playbooks replace srprov's own by name, or add to them; the plan names them.

    Exits with 0; with 2 when --detailed-exitcode is given and something would change, a job has failed or a service is
    unhealthy; with 4 when a robot cannot be reached, unless --unreachable says otherwise.
    """
    from srprov.controller.secrets import read_secrets
    from srprov.controller.source import read_definitions

    _check_target(target, sign)
    definitions = read_definitions(file, request.allowed, request.profiles, locked=locked)
    vault = read_secrets(definitions, request.allowed)
    inventory = inputs.load_inventory(inventories)
    last = inputs.failed_robots(request.instance or definitions.experiment.name, runs)
    chosen = inputs.selected(inventory, limit, exclude, last)
    with (
        inputs.connect(inventory, timeout, forks) as fleet,
        answers_only(),
        fleet.look(definitions.experiment, exact=True) as look,
    ):
        from srprov.controller.plan import make_plan  # a tenth of a second of imports, while the robots are asked
        from srprov.controller.targets import only_targets

        request = inputs.with_own_files(replace(request, exact=True), definitions.experiment)
        planned = only_targets(make_plan(definitions, look, request, vault), request.targets).limited(chosen)
    from srprov.controller.saved import kept_plan
    from srprov.planning.markdown import plan_markdown
    from srprov.planning.planhash import shown_json

    made = planned.plan
    if target:
        write_plan(target, kept_plan(planned), vault, definitions.variables, sign)
    if form == "markdown" and not as_json:
        out_whole(plan_markdown(made, commands=verbose, hide=clean).rstrip())
    else:
        show_plan(made, shown_json(made) if as_json or form == "json" else None, verbose=verbose, reviewed=True)
    if made.unreachable and unreachable == "fail":
        return UNREACHABLE
    return DIFFERENCES if detailed_exitcode and (not made.empty or planned.amiss) else 0


def _check_target(target: str | None, sign: str | None) -> None:
    """Refuse a name that `apply` would not take for a plan's, and a signature of nothing."""
    from srprov.controller.source import EDF_ENDINGS, is_edf_name

    if sign and not target:
        raise UsageError("--sign signs the file that -o writes", hint="add -o plan.json", code=Code.OPTIONS)
    if target and is_edf_name(target):
        hint = "name it plan.json, say"
        raise UsageError(
            f"a plan's name does not end in {', '.join(EDF_ENDINGS)}: EDFs' do", hint=hint, code=Code.OPTIONS
        )


def write_plan(
    target: str, file: PlanFile, vault: Vault, variables: Vault | None = None, sign: str | None = None
) -> None:
    """Write a plan file, for its owner alone, and with the key `sign` a signature beside it.

    It is done as it stands, so a secret in it can only be refused.

    Raises:
        UsageError: The file would be too large to be read again, or cannot be written.
        RefusedError: The value of a secret stands in what the plan does: in another field of the user's files; or that
            of one of `variables`, which come from the controller's environment.
    """
    from srprov.planning.planfile import dump

    try:
        text = dump(replace(file, inputs={name: redact(text) for name, text in file.inputs.items()}))
    except ValueError as error:
        hint = "apply the EDF itself, or ship less: what is large belongs in an image or a volume"
        raise UsageError(str(error), hint=hint, code=Code.OPTIONS) from None
    if name := vault.holds(text):
        hint = f"take it out of the definition files, or give '{name}' a value that is not an everyday word"
        wrong = f"the value of the secret '{name}' stands in the plan itself; no file was written"
        raise RefusedError(wrong, hint=hint, code=Code.SECRET_SHOWN)
    if variables and (name := variables.holds(text)):
        hint = "make it a secret of the experiment (docs/secrets.md), or apply the EDF itself"
        wrong = f"the value of the variable '{name}' stands in the plan; no file was written"
        raise RefusedError(wrong, hint=hint, code=Code.SECRET_SHOWN)
    content = text.encode("utf-8", "replace")
    outputs = {target: content}
    if sign:
        from srprov.controller.signature import signature

        outputs[f"{target}.sig"] = signature(content, target, sign)
    for name, data in outputs.items():
        try:
            private.write_output(name, data)
        except OSError as error:
            raise UsageError(
                f"cannot write {name}: {error.strerror}", hint="name another file", code=Code.CANNOT_WRITE
            ) from error


def show_plan(
    made: Plan, as_json: Mapping[str, Any] | None, *, verbose: bool, color: bool = True, reviewed: bool = False
) -> None:  # fmt: skip
    """Print a plan as text, or as JSON with a one-line summary beside it.

    One that is `reviewed`, and done later, has its hash, and a word on a placement that may be another one by then.
    """
    from srprov.cli.plan_colors import painted
    from srprov.planning.plan import ASKED
    from srprov.planning.planhash import plan_hash
    from srprov.planning.text import plan_text, summary

    if as_json is None:
        text = plan_text(made, commands=verbose, hide=clean).rstrip()
        out_whole(text, painted if color else str)
        if reviewed and not made.empty:
            out_whole(f"Its hash, for `apply --expect`: {plan_hash(made)}")
        if reviewed and made.chosen:
            told = "The placement was chosen by how the robots are at this moment; `plan -o FILE` keeps it for `apply`."
            out_whole(told)
    else:
        steps = [_shown(one) for one in as_json["steps"]]
        out_json_whole({**as_json, "steps": steps}, {*ASKED, "steps"})
        err_whole(summary(made))


def _shown(step: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a step without secrets where it may hold one: what a new container has follows from none."""
    return {key: one if key == "makes" else redacted(one) for key, one in step.items()}
