"""Options that say which trials are run, and where they are kept."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import click

_F = TypeVar("_F", bound=Callable[..., Any])

_OPTIONS = (
    click.option("-o", "--out", "target", type=click.Path(file_okay=False, path_type=Path), default=None, metavar="DIR",
                 help="Where the run is kept (default: a new folder below ~/.local/state/srprov/trials)."),
    click.option("--resume", is_flag=True, help="Go on with the run in DIR: only what has not ended is run."),
    click.option("--only", multiple=True, metavar="TRIAL|POINT",
                 help="Only this trial, or trials of this point; may be repeated; `srprov trials FILE` lists them."),
    click.option("--rerun", multiple=True, metavar="TRIAL|POINT",
                 help="With --resume: run it again; what it gave before is kept, and counts no more; may be repeated."),
    click.option("--discard", multiple=True, metavar="TRIAL|POINT",
                 help="With --resume: it counts no more and is not run; may be repeated. Nothing else is done, and no "
                      "robot is asked."),
    click.option("--reason", default="", metavar="TEXT", help="Why, for the table; with --discard or --rerun."),
    click.option("--accept-changes", is_flag=True,
                 help="With --resume: go on although the experiment has changed; the column `segment` tells."),
)  # fmt: skip


def which(function: _F) -> _F:
    """Add them; the verb gets `wanted`, a TrialsRequest."""

    @functools.wraps(function)
    def with_wanted(
        *, target: Path | None, resume: bool, only: tuple[str, ...], rerun: tuple[str, ...],
        discard: tuple[str, ...], reason: str, accept_changes: bool, **more: object,
    ) -> object:  # fmt: skip
        from srprov.controller.trial_request import TrialsRequest

        wanted = TrialsRequest(
            folder=target,
            resume=resume,
            only=only,
            rerun=rerun,
            discard=discard,
            reason=reason,
            accept_changes=accept_changes,
        )
        return function(wanted=wanted, **more)

    made: Any = with_wanted
    for option in reversed(_OPTIONS):
        made = option(made)
    return cast("_F", made)
