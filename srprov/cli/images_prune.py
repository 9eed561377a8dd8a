"""`srprov images prune`: show what goes, ask, and remove it as any run removes things."""

from __future__ import annotations

import datetime as dt
from pathlib import Path
from typing import TYPE_CHECKING

from srprov.cli.execute import carried_out, confirm
from srprov.cli.output import counted, err, out
from srprov.cli.status import table
from srprov.controller.image_rows import COLUMNS, cache_size, clear_cache, rows
from srprov.controller.phases import Phases
from srprov.controller.prune import Pruning, choose, freed_by
from srprov.controller.stored_images import stores
from srprov.record import default_root, named_images
from srprov.sizes import size_text

if TYPE_CHECKING:
    from srprov.controller.fleet import Fleet
    from srprov.execution import RunOptions

_DAY_S = 86_400


def prune(
    fleet: Fleet, only: frozenset[str] | None, runs: Path | None, run_options: RunOptions, older_than: float,
    *, yes: bool, cache: bool, as_json: bool,
) -> int:  # fmt: skip
    """Remove images that nobody uses, and return the exit code.

    Args:
        fleet: The robots.
        only: Repositories of one experiment; None: any image.
        runs: Where runs are recorded; None: the default.
        run_options: How the run behaves.
        older_than: Days since an image was built.
        yes: The user was asked already.
        cache: Also empty the cache of layers on this machine.
        as_json: Print what came of it as JSON.
    """
    phases = Phases()
    phases.begin("facts")
    there, unreachable = stores(fleet, whole=True)
    now = dt.datetime.now(dt.timezone.utc)
    before = now.timestamp() - older_than * _DAY_S if older_than else None
    made = choose(there, unreachable, named_images(runs or default_root()), only=only, before=before)
    if not as_json:
        _show(made, now)
    folder, kept = cache_size()
    also = f" and remove {size_text(kept)} of layers from {folder}" if cache else ""
    confirm(made.planned.plan, yes, run_options.stop_timeout_s, also)
    phases.begin("prune")
    report = carried_out(made.planned, fleet, run_options, phases, as_json=as_json, events=None, color=True, runs=runs)
    if made.gone:
        err(f"{size_text(freed_by(report.result, made, there))} became free")
    if cache:
        err(f"{size_text(clear_cache())} of layers were removed from {folder}")
    return report.result.exit_code


def _show(made: Pruning, now: dt.datetime) -> None:
    lines = [row for robot, images in made.gone.items() for row in rows(robot, images, {}, now)]
    out(table(lines, [one for one in COLUMNS if one != "used by"]) if lines else "nothing to remove")
    for robot, images in made.gone.items():
        out(f"{robot}: {counted(len(images), 'image')}, {size_text(made.freed[robot])} will be freed")
    stays = "stays" if made.stay == 1 else "stay"
    out(f"{counted(made.stay, 'image')} of srprov's {stays}; `srprov images` says who uses them")
