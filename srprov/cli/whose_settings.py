"""Whether a file of settings may say what srprov does: whose it is, and who else could have written it."""

from __future__ import annotations

import os
from pathlib import Path

from srprov.believed import is_out_of_reach
from srprov.codes import Code
from srprov.errors import UsageError
from srprov.whose import others_may_write


def check_owner(path: Path, about: os.stat_result, *, own: bool) -> None:
    """Refuse a file that somebody else could change; `own` is the user's, else it is a project's.

    Raises:
        UsageError: It is another user's, or others may write to it or replace it; or, of a project's, an archive may
            have given it to a file of the user's as a further name, whose words would be told as mistakes.
    """
    if about.st_uid not in (0, os.geteuid()):
        raise UsageError(
            f"{path} belongs to another user, who could change what srprov does",
            hint=f"look at it, then make it yours: chown {os.geteuid()} FILE",
            code=Code.STRANGE_FILE,
        )
    if others_may_write(path, about):
        raise UsageError(
            f"{path} can be written by other users", hint="look at it, then: chmod go-w FILE", code=Code.STRANGE_FILE
        )
    if own and not is_out_of_reach(path):
        raise UsageError(
            f"{path} could be replaced by other users, who may write to a folder above it",
            hint="look at it, then take that right away: chmod go-w FOLDER",
            code=Code.STRANGE_FILE,
        )
    if not own and about.st_nlink > 1:
        raise UsageError(
            f"{path} has another name (a hard link)",
            hint="look at it, then put a copy in its place: cp FILE COPY && mv COPY FILE",
            code=Code.STRANGE_FILE,
        )
