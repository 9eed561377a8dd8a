"""`srprov wait`: until jobs have completed, services are healthy, or something was printed."""

from __future__ import annotations

import click

from srprov.cli import inputs, options
from srprov.cli.codes import FAILED, UNREACHABLE
from srprov.cli.output import err
from srprov.cli.seconds import Seconds
from srprov.codes import Code
from srprov.errors import visible


@click.command()
@click.argument("file", metavar="FILE")
@options.robots_without_json
@options.INSTANCE
@click.option("--until", multiple=True, required=True, metavar="CONDITION",
              help="completed:SERVICE, healthy, healthy:SERVICE or log:SERVICE=REGEX; may be repeated.")  # fmt: skip
@click.option("--wait-timeout", type=Seconds(min=1), default=3600.0, show_default=True, metavar="S",
              help="Seconds until all conditions must hold.")  # fmt: skip
def wait(
    file: str, inventories: tuple[str, ...], forks: int, timeout: float, instance: str, until: tuple[str, ...],
    wait_timeout: float,
) -> int:  # fmt: skip
    """Wait until every condition holds. Changes nothing, and needs no lock.

    \b
    completed:SERVICE  it has ended with code 0
    healthy            every service that has a healthcheck is healthy
    healthy:SERVICE    this one is
    log:SERVICE=REGEX  some line of its log, old or new, matches (RE2)

    SERVICE is a name of the EDF, which means all its replicas, a replica, or SERVICE@ROBOT.

    Exits with 0 when all hold; with 3 when one cannot hold any more (a job failed, a container is gone) or the time is
    over; with 4 when a robot that is needed stays out of reach for two minutes.
    """  # noqa: D301 - click's mark for lines that it does not wrap
    from srprov.controller.awaiting import awaited
    from srprov.controller.awaiting import wait as wait_for
    from srprov.controller.located import locate
    from srprov.facts.gather import Detail

    inventory = inputs.load_inventory(inventories)
    name, source = inputs.named_instance(file, instance)
    experiment = inputs.experiment_if_valid(file)
    with inputs.connect(inventory, timeout, forks) as fleet:
        snapshot = fleet.gather(Detail.BASIC)
        inputs.tell_maker(snapshot, name, source)
        there = locate(snapshot, name, experiment)
        for note in there.notes:
            err(f"note: {visible(note)}")
        ended = wait_for(awaited(until, there), fleet, wait_timeout, lambda text: err(visible(text)))
    if not ended.why:
        return 0
    err(f"error[{Code.AWAITED}]: {visible(ended.why)}")
    return UNREACHABLE if ended.unreachable else FAILED
