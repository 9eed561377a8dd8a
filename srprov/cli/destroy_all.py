"""`srprov destroy --all-instances`: what there is, one question about all of it, then one instance after the other."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import TYPE_CHECKING

import click

from srprov import names
from srprov.cli.codes import INTERRUPTED
from srprov.cli.output import below, counted, err, out, tell_unreachable
from srprov.cli.status import table
from srprov.codes import Code
from srprov.errors import RefusedError, SrprovError, UsageError, visible

if TYPE_CHECKING:
    from srprov.controller.fleet import Fleet
    from srprov.controller.instances import Instance

_COLUMNS = ("instance", "made from", "robots", "containers", "volumes")


def check_all(file: str | None, instance: str, *, as_json: bool, volumes: bool, adopt: bool) -> None:
    """Refuse what does not go with --all-instances.

    Raises:
        UsageError: An option contradicts it.
        RefusedError: Data would go whose EDF is not named, and so not whose it is.
    """
    if instance or as_json:
        with_it = "--instance" if instance else "--json"
        hint = (
            "leave it out" if instance else "--events FILE has each run; or destroy one after the other, by --instance"
        )
        raise UsageError(f"--all-instances does not go with {with_it}", hint=hint, code=Code.OPTIONS)
    if volumes and not adopt and file is None:
        raise RefusedError(
            "--all-instances --volumes would remove data of whoever made it",
            hint="name the EDF that made it, or say --adopt",
            code=Code.OWNER,
        )


def destroy_all(
    fleet: Fleet, source: str, chosen: Collection[str], one: Callable[[str], int], *, yes: bool, volumes: bool,
    adopt: bool,
) -> int:  # fmt: skip
    """List the instances on robots, ask, and destroy each; return the first exit code that is not 0.

    Args:
        fleet: The robots.
        source: Whose instances; empty: everybody's.
        chosen: The robots that may be changed.
        one: Destroys the instance of a name, without a question, and returns its exit code.
        yes: Do not ask.
        volumes: Data goes too.
        adopt: Also those that another file made.
    """
    from srprov.controller.instances import instances_there
    from srprov.facts.gather import Detail

    snapshot = fleet.gather(Detail.BASIC)
    # what has another name was not made by srprov
    every = [found for found in instances_there(snapshot, chosen) if names.valid("instance", found.name)]
    mine = [found for found in every if adopt or not source or source in found.sources]
    if others := [found.name for found in every if found not in mine]:
        err(f"note: another file made {', '.join(others)}: left alone; --adopt takes them, too")
    away = tell_unreachable(snapshot.unreachable)
    if not mine:
        err("no instance to destroy on these robots")
        return away
    out(_listed(mine))
    _ask(mine, yes=yes, volumes=volumes)
    codes = [0]
    for found in mine:
        err(f"destroying {found.name}")
        try:
            codes.append(one(found.name))
        except SrprovError as error:  # the others are not less to be destroyed
            hint = f"\n  {visible(error.hint)}" if error.hint else ""
            err(f"error: {found.name}: {below(error.message)}{hint}")
            codes.append(error.exit_code)
        if codes[-1] == INTERRUPTED:
            break
    return next(filter(None, codes), away)


def _listed(mine: Sequence[Instance]) -> str:
    rows = [
        {
            "instance": found.name,
            "made from": ", ".join(found.sources) or "not known",
            "robots": ", ".join(found.robots),
            "containers": found.containers,
            "volumes": found.volumes,
        }
        for found in mine
    ]
    return table(rows, _COLUMNS)


def _ask(mine: Sequence[Instance], *, yes: bool, volumes: bool) -> None:
    """Ask about all of them at once, unless the user said yes.

    Raises:
        RefusedError: The answer is no.
    """
    if yes:
        return
    robots = {robot for found in mine for robot in found.robots}
    data = sum(found.volumes for found in mine)
    lost = f" The data of {counted(data, 'volume')} is lost." if volumes and data else ""
    question = f"Destroy {visible(', '.join(found.name for found in mine))} on {counted(len(robots), 'robot')}?{lost}"
    if not click.confirm(question, err=True):
        raise RefusedError("not confirmed; nothing was changed", code=Code.NOT_CONFIRMED)
