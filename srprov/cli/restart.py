"""`srprov restart`: stop services and start them again, each after those named here that it depends on."""

from __future__ import annotations

from typing import Any

import click

from srprov.cli.orders import give_order, order_options


@click.command()
@click.argument("file", metavar="FILE")
@click.argument("services", metavar="SERVICE...", nargs=-1, required=True)
@order_options
def restart(file: str, services: tuple[str, ...], **more: Any) -> int:  # noqa: ANN401 - the options of all three verbs
    """Stop services and start them again, each after those named here that it depends on.

    Their containers stay the same, with all that is in them. One that does not run is started.
    """
    return give_order("restart", file, services, **more)
