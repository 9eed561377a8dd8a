"""Earlier runs from a folder, for fairness. Reads files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from srprov import regular_file
from srprov.assignment.fairness import read_record
from srprov.codes import Code
from srprov.definitions import refuse_link_out
from srprov.errors import UsageError
from srprov.untrusted import parse_json


def read_history(folder: Path | None) -> tuple[Mapping[str, float], ...]:
    """Return each run's costs per robot, in the order of the folders' names; nothing without a folder.

    Raises:
        UsageError: A record cannot be read, or a link of a relative path leads out of its folder.
    """
    if folder is None:
        return ()
    refuse_link_out(str(folder), "--history ")
    runs = []
    for path in sorted(folder.glob("*/assignment.json")):
        refuse_link_out(str(path))
        try:
            runs.append(read_record(parse_json(regular_file.read_text(path)), str(path)))
        except (OSError, ValueError) as error:
            why = error.strerror if isinstance(error, OSError) else error
            raise UsageError(
                f"{path}: {why}", hint="remove it, or name another folder with --history", code=Code.RECORD
            ) from error
    return tuple(runs)
