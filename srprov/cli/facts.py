"""`srprov facts`: the robots as they are."""

from __future__ import annotations

import click

from srprov.cli import inputs, options
from srprov.cli.output import err, out, out_json

UNREACHABLE = 4


@click.command()
@options.robots
@options.LIMIT
@options.EXCLUDE
def facts(inventories: tuple[str, ...], as_json: bool, forks: int, timeout: float, limit: str, exclude: str) -> int:
    """Show the robots as they are: load, memory, links, devices, tags, Docker."""
    import dataclasses

    from srprov.cli.facts_table import facts_table
    from srprov.facts.document import facts_document
    from srprov.facts.gather import Detail

    whole = inputs.load_inventory(inventories)
    chosen = inputs.selected(whole, limit, exclude)
    inventory = dataclasses.replace(whole, hosts={name: host for name, host in whole.hosts.items() if name in chosen})
    with inputs.connect(inventory, timeout, forks) as fleet:
        snapshot = fleet.gather(Detail.TRAFFIC, keep_mute=True)
    if as_json:
        out_json(facts_document(snapshot.facts, snapshot.unreachable))
    else:
        out(facts_table(snapshot.facts, snapshot.unreachable))
    for host, reason in sorted(snapshot.unreachable.items()):
        err(f"unreachable: {host}: {reason}")
    return UNREACHABLE if snapshot.unreachable else 0
