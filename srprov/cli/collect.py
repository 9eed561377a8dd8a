"""`srprov collect`: results, logs and facts of the running experiment, brought home."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from srprov.cli import inputs, options
from srprov.cli.codes import FAILED, UNREACHABLE
from srprov.cli.output import counted, err, out, out_json, tell_unreachable
from srprov.codes import Code
from srprov.errors import UsageError, visible

_MOST_TOLD = 1000
"""Lines of a kind: a robot may have any number of files that cannot be read."""


@click.command()
@click.argument("file", metavar="FILE")
@options.robots
@options.INSTANCE
@click.option(
    "-o", "--out", "target", type=click.Path(file_okay=False, path_type=Path), required=True, metavar="DIR",
    help="Where it comes: a new folder, or one of an earlier collect of the same instance.",
)  # fmt: skip
def collect(
    file: str, inventories: tuple[str, ...], as_json: bool, forks: int, timeout: float, instance: str, target: Path
) -> int:
    """Bring home the results, logs and facts of an applied experiment; nothing is changed on robots.

    Results are what FILE names in `results`. Each file is compared by its sha256. Into a folder of an earlier collect
    comes only what is missing there or has changed, and a transfer that was cut goes on where it ended. What another
    file made under FILE's name is not brought, unless you name it: --instance.

    Exits with 0; with 3 when something that is there could not be fetched, or a required result is missing; with 4 when
    a robot cannot be reached: what the others have is fetched.
    """
    from srprov.controller.collected import check_folder
    from srprov.controller.own_output import shipping

    inventory = inputs.load_inventory(inventories)
    definitions = inputs.load_experiment(file)
    experiment = definitions.experiment
    name, source = inputs.named_instance(file, instance)
    check_folder(target, name)
    if (by := shipping(definitions, target)) is not None:
        err(visible(f"warning: {target} is in {by.source}: the next plan sends what comes there, too; {by.remedy}"))
    with inputs.connect(inventory, timeout, forks) as fleet:
        from srprov.controller.collection import collect as bring  # half a second of imports, while robots connect

        try:
            document = bring(
                fleet, experiment, name, target, lambda text: err(visible(text)), source=source, meant=bool(instance)
            )
        except OSError as error:
            hint = "what is in the folder is whole; collect again when that is mended"
            raise UsageError(
                f"{error.filename or target}: {error.strerror or error}", hint=hint, code=Code.CANNOT_WRITE
            ) from error
    if as_json:
        out_json({"folder": str(target), **document})
    else:
        _show(document, target)
    away = tell_unreachable(document["unreachable"])
    required = any(line.endswith("which is required") for line in document["missing"])
    return FAILED if document["failed"] or required else UNREACHABLE if away else 0


def _show(document: Mapping[str, Any], folder: Path) -> None:
    here = sum(bool(one.get("name")) for some in document["results"].values() for one in some)
    fetched = f"{counted(document['fetched_files'], 'file')} fetched, {document['fetched_bytes']} bytes"
    out(f"{counted(here, 'result file')} in {visible(str(folder))}; {fetched}")
    for word, key in (("not closed", "unclosed"), ("missing", "missing"), ("not fetched", "failed")):
        for line in document[key][:_MOST_TOLD]:
            err(f"{word}: {visible(line)}")
        if (more := len(document[key]) - _MOST_TOLD) > 0:
            err(f"{word}: {more} more, which collected.json names")
