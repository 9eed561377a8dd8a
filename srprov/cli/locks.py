"""`srprov locks`: who is changing which robot, and since when."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import click

from srprov.cli import inputs, options
from srprov.cli.output import out, out_json, tell_unreachable
from srprov.cli.status import table

if TYPE_CHECKING:
    from srprov.execution.locks import Holder

_KEYS = ("owner", "pid", "purpose", "run", "since", "age_s")


@click.command()
@options.robots
def locks(inventories: tuple[str, ...], as_json: bool, forks: int, timeout: float) -> int:
    """Show who holds which robot, and since when; takes no lock."""
    from srprov.execution.locks import holders

    inventory = inputs.load_inventory(inventories)
    with inputs.connect(inventory, timeout, forks) as fleet:
        held, unreachable = holders(inventory.hosts, fleet.sessions.get, forks=forks)
    if as_json:
        out_json(document(held, unreachable))
    elif any(held.values()):
        out(table(rows(held), ("robot", "owner", "pid", "purpose", "since", "for", "run")))
    else:
        out("nobody holds a robot")
    return tell_unreachable(unreachable)


def document(held: Mapping[str, Holder | None], unreachable: Mapping[str, str]) -> dict[str, Any]:
    """Return the documented JSON: robot -> who holds it, or null."""
    robots = {name: {key: getattr(one, key) for key in _KEYS} if one else None for name, one in sorted(held.items())}
    return {"robots": robots, "unreachable": dict(sorted(unreachable.items()))}


def rows(held: Mapping[str, Holder | None]) -> list[dict[str, Any]]:
    """Return one row per robot that somebody holds."""
    from srprov.execution.locks import age

    return [
        {"robot": name, **{key: getattr(one, key) for key in _KEYS}, "owner": one.owner or "?", "for": age(one.age_s)}
        for name, one in sorted(held.items())
        if one
    ]
