"""`srprov start`: start services that do not run, or all of them: each after those that it depends on."""

from __future__ import annotations

from typing import Any

import click

from srprov.cli.orders import give_order, order_options


@click.command()
@click.argument("file", metavar="FILE")
@click.argument("services", metavar="[SERVICE]...", nargs=-1)
@order_options
def start(file: str, services: tuple[str, ...], **more: Any) -> int:  # noqa: ANN401 - the options of all three verbs
    """Start services that do not run, or all of them: each after those that it depends on.

    Without names, jobs that have ended are left alone; a job that is named is run again.
    """
    return give_order("start", file, services, **more)
