"""`srprov stop`: stop services, or all of them: dependents first, each with its stop signal and its grace."""

from __future__ import annotations

from typing import Any

import click

from srprov.cli.orders import give_order, order_options


@click.command()
@click.argument("file", metavar="FILE")
@click.argument("services", metavar="[SERVICE]...", nargs=-1)
@order_options
def stop(file: str, services: tuple[str, ...], **more: Any) -> int:  # noqa: ANN401 - the options of all three verbs
    """Stop services, or all of them: dependents first, each with its stop signal and its grace.

    Containers stay, with what is in them. `status` and `plan` name them, and `apply` starts them again, but for jobs;
    `srprov start` does it without a plan.
    """
    return give_order("stop", file, services, **more)
