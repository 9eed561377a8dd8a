"""`srprov facts`: the robots as they are."""

from __future__ import annotations

import click

from srprov.cli import options
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
    from srprov.facts.gather import Detail, gather

    whole = options.load_inventory(inventories)
    chosen = options.selected(whole, limit, exclude)
    inventory = dataclasses.replace(whole, hosts={name: host for name, host in whole.hosts.items() if name in chosen})
    with options.open_lab(inventory, timeout, forks) as lab:
        found = gather(inventory, lab.sessions.get, closer=Detail.TRAFFIC, forks=forks, only_look=True)
    if as_json:
        out_json(facts_document(found.facts, found.unreachable))
    else:
        out(facts_table(found.facts, found.unreachable))
    for host, reason in sorted(found.unreachable.items()):
        err(f"unreachable: {host}: {reason}")
    return UNREACHABLE if found.unreachable else 0
