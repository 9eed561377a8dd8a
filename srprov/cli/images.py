"""`srprov images`: which images srprov built, where they are, how large, and who uses them; `images prune`."""

from __future__ import annotations

import datetime as dt
from pathlib import Path
from typing import TYPE_CHECKING

import click

from srprov.cli import inputs, options, output_options
from srprov.cli.execute import refuse_without_terminal
from srprov.cli.output import err, out, out_json, tell_unreachable
from srprov.cli.status import table
from srprov.codes import Code
from srprov.errors import UsageError
from srprov.sizes import size_text

if TYPE_CHECKING:
    from srprov.controller.fleet import Fleet
    from srprov.session import Pulse


@click.command()
@click.argument("words", metavar="[prune] [FILE]", nargs=-1)
@options.robots
@options.chosen
@options.waiting
@options.RUNS
@click.option("--older-than", type=click.FloatRange(min=0), default=0.0, metavar="DAYS",
              help="prune: only images that were built more than so many days ago.")  # fmt: skip
@click.option("--cache", is_flag=True, help="prune: also empty the cache of layers on this machine.")
@click.option("-y", "--yes", is_flag=True, help="prune: do not ask.")
@output_options.QUIET
def images(
    words: tuple[str, ...], inventories: tuple[str, ...], as_json: bool, forks: int, timeout: float, limit: str,
    exclude: str, lock_wait: float, pulse: Pulse, runs: Path | None, older_than: float, cache: bool, yes: bool,
) -> int:  # fmt: skip
    """Show the images that srprov built: where they are, how large, who uses them; with FILE, one experiment's.

    `srprov images prune` removes those that nobody uses: no container was made from them, the last recorded run of no
    instance named them, and nobody gave them another name. It shows what goes, and asks.
    """
    pruning = words[:1] == ("prune",)
    files = words[1:] if pruning else words
    if files[1:]:
        raise UsageError(f"what is {files[1]}?", hint="srprov images [prune] [FILE] -i INVENTORY", code=Code.OPTIONS)
    if pruning:
        refuse_without_terminal(yes)
    inventory = inputs.load_chosen(inventories, limit, exclude)
    only = _repositories(files[0]) if files else None
    with inputs.connect(inventory, timeout, forks, changing=pruning) as fleet:
        output_options.note(f"asking {len(inventory.hosts)} robots for images")
        if not pruning:
            return _list(fleet, only, runs, as_json=as_json)
        from srprov.cli.images_prune import prune
        from srprov.execution import RunOptions

        done = RunOptions(verb="prune", forks=forks, lock_wait_s=lock_wait, pulse=pulse, settle_s=0.0)
        return prune(fleet, only, runs, done, older_than, yes=yes, cache=cache, as_json=as_json)


def _repositories(file: str) -> frozenset[str]:
    from srprov.controller.image_rows import repositories_of

    return repositories_of(file)


def _list(fleet: Fleet, only: frozenset[str] | None, runs: Path | None, *, as_json: bool) -> int:
    from srprov.controller.image_rows import COLUMNS, cache_size, of_experiment, robots_json, rows
    from srprov.controller.stored_images import stores
    from srprov.record import default_root, named_images

    there, unreachable = stores(fleet)
    if only is not None:
        there = {robot: of_experiment(store, only) for robot, store in there.items()}
    named, (folder, kept) = named_images(runs or default_root()), cache_size()
    if as_json:
        cache = {"folder": folder, "bytes": kept}
        out_json({"robots": robots_json(there, named), "cache": cache, "unreachable": unreachable})
        return tell_unreachable(unreachable)
    now = dt.datetime.now(dt.timezone.utc)
    lines = [row for robot, store in sorted(there.items()) for row in rows(robot, store.images, named, now)]
    out(table(lines, COLUMNS) if lines else "no images of srprov's on these robots")
    for robot, store in sorted(there.items()):
        if store.images:
            err(f"{robot}: {size_text(store.bytes_of(store.images))}, with each layer counted once")
    err(f"layers on this machine: {size_text(kept)} in {folder}")
    return tell_unreachable(unreachable)
