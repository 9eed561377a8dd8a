"""`srprov probe`: whether all robots and services of an instance reach each other over the overlay."""

from __future__ import annotations

import click

from srprov.cli import inputs, options
from srprov.cli.codes import FAILED
from srprov.cli.output import err, out, out_json, tell_unreachable
from srprov.errors import visible


@click.command()
@click.argument("file", metavar="[FILE]", required=False)
@options.robots
@options.INSTANCE
def probe(
    file: str | None, inventories: tuple[str, ...], as_json: bool, forks: int, timeout: float, instance: str
) -> int:
    """Try the overlay: every robot's address and every service's, from every robot and every service.

    Small packets, packets as large as the MTU, TCP and multicast, from inside the containers' own networks. Nothing is
    installed: a small program runs on the robots for a moment. It is not part of any container.

    What fails is named with its pair and the likely cause. With FILE or --instance.

    Exits with 0 when everything works; with 3 when something fails; with 4 when a robot cannot be reached.
    """
    from srprov.controller.probe import probe_fleet, request_for
    from srprov.facts.gather import Detail
    from srprov.probing.document import text

    inventory = inputs.load_inventory(inventories)
    name, source = inputs.named_instance(file, instance)
    with inputs.connect(inventory, timeout, forks, changing=True) as fleet:
        snapshot = fleet.gather(Detail.BASIC)
        inputs.tell_maker(snapshot, name, source)
        request, notes = request_for(snapshot, name)
        for note in notes:
            err(f"note: {visible(note)}")
        said = probe_fleet(fleet, snapshot, request).json()
    if as_json:
        out_json(said)
    else:
        out(text(said))
    members = {robot: why for robot, why in snapshot.unreachable.items() if robot in request.robots}
    return FAILED if said["causes"] else tell_unreachable(members) or (FAILED if said["unreachable"] else 0)
