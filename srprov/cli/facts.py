"""`srprov facts`: the robots as they are."""

from __future__ import annotations

import click

from srprov.cli import inputs, options
from srprov.cli.output import out, out_json, tell_unreachable


@click.command()
@options.robots
@options.chosen
def facts(inventories: tuple[str, ...], as_json: bool, forks: int, timeout: float, limit: str, exclude: str) -> int:
    """Show the robots as they are: load, memory, links, devices, tags, Docker."""
    from srprov.cli.facts_table import facts_table
    from srprov.facts.document import facts_document
    from srprov.facts.gather import Detail

    inventory = inputs.load_chosen(inventories, limit, exclude)
    with inputs.connect(inventory, timeout, forks) as fleet:
        snapshot = fleet.gather(Detail.TRAFFIC, keep_mute=True)
    if as_json:
        out_json(facts_document(snapshot.facts, snapshot.unreachable))
    else:
        out(facts_table(snapshot.facts, snapshot.unreachable))
    return tell_unreachable(snapshot.unreachable)
