"""`--history`: earlier runs from a folder, for fairness."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import click

from srprov.errors import UsageError

HISTORY = click.option(
    "--history", type=click.Path(exists=True, file_okay=False, path_type=Path), default=None, metavar="DIR",
    help="Earlier runs (DIR/*/assignment.json): fairness evens out what robots carried in them.",
)  # fmt: skip


def read_history(folder: Path | None) -> tuple[Mapping[str, float], ...]:
    """Return each run's costs per robot, in the order of the folders' names; nothing without a folder.

    Raises:
        UsageError: A record cannot be read.
    """
    if folder is None:
        return ()
    from srprov.assignment.fairness import read_record
    from srprov.facts.stored import parse

    runs = []
    for path in sorted(folder.glob("*/assignment.json")):
        try:
            runs.append(read_record(parse(path.read_text(encoding="utf-8")), str(path)))
        except (OSError, ValueError) as error:
            raise UsageError(f"{path}: {error}", hint="remove it, or name another folder with --history") from error
    return tuple(runs)
