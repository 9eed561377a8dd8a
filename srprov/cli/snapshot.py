"""`srprov snapshot`: robots that were set up by hand, as an experiment."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from srprov import names
from srprov.cli import inputs, options
from srprov.cli.output import counted, out, out_json, tell_unreachable
from srprov.cli.output_options import no_link
from srprov.errors import visible


@click.command()
@click.argument("robots", metavar="ROBOT...", nargs=-1, required=True)
@options.robots
@click.option(
    "-o", "--out", "target", type=click.Path(file_okay=False, path_type=Path), required=True, metavar="DIR",
    callback=no_link,
    help="The folder that is written; it must not be there yet, or be empty.",
)  # fmt: skip
@options.INSTANCE
def snapshot(
    robots: tuple[str, ...], inventories: tuple[str, ...], as_json: bool, forks: int, timeout: float, target: Path,
    instance: str,
) -> int:  # fmt: skip
    """Write an experiment from robots that were set up by hand; nothing is changed on them.

    ROBOT is a name or pattern of the inventory. Containers that run become services; the host itself becomes a CDF,
    whose service has the profile `host`. Values that look like secrets are not written: the EDF names variables for
    them. What could not be captured is in report.md. Look through the folder before you give it to anybody.

    Exits with 0; with 4 when a robot cannot be reached: what the others have is written.
    """
    from srprov.controller.snapshot import snapshot as take

    inventory = inputs.load_chosen(inventories, ",".join(robots), "")
    name = instance or names.checked("instance", "snapshot")
    with inputs.connect(inventory, timeout, forks) as fleet:
        document = take(fleet, target, name)
    if as_json:
        out_json(document)
    else:
        _show(document)
    return tell_unreachable(document["unreachable"])


def _show(document: Mapping[str, Any]) -> None:
    services = sum(len(robot["services"]) for robot in document["robots"].values())
    hosts = sum(bool(robot["cdf"]) for robot in document["robots"].values())
    out(visible(f"{document['folder']}: {counted(services, 'service')}, {counted(hosts, 'host')}"))
    titles = {"lost": "not captured", "adapted": "to know", "secret": "looks like a secret"}
    for note in document["notes"]:
        out(visible(f"{note['robot']}: {titles[note['kind']]}: {note['subject']}: {note['words']}"))
    for one in document["secrets"]:
        whose = f"the secret {one['secret']} of {one['service']} on {one['robot']}"
        out(visible(f"set {one['env']} before a plan: {whose}"))
