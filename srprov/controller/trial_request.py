"""What the user asks of a run of trials beside the files."""

from __future__ import annotations

from pathlib import Path

import msgspec

from srprov.codes import Code
from srprov.errors import UsageError

BY_HAND = "run again by hand"


class TrialsRequest(msgspec.Struct, frozen=True, kw_only=True):
    """Which trials are run, and where they are kept."""

    folder: Path | None = None
    """Where the run is kept; None: below the folder of all runs."""
    resume: bool = False
    """Go on with the run that is in the folder."""
    only: tuple[str, ...] = ()
    """Ids of trials or points; empty: all."""
    rerun: tuple[str, ...] = ()
    """Ids of trials that are run again, whatever came of them."""
    discard: tuple[str, ...] = ()
    """Ids of trials that count no more; nothing is run then."""
    reason: str = ""
    """Why they do not, for the table."""
    accept_changes: bool = False
    """Go on although it is not the same experiment any more."""

    def __post_init__(self) -> None:
        """Refuse what does not go together.

        Raises:
            UsageError: So it is.
        """
        of_resume = {"--discard": self.discard, "--rerun": self.rerun, "--accept-changes": self.accept_changes}
        if not self.resume and (given := [name for name, value in of_resume.items() if value]):
            raise UsageError(
                f"{given[0]} is about a run that was begun", hint="name its folder: --resume -o DIR", code=Code.OPTIONS
            )
        if self.discard and not self.reason.strip():
            raise UsageError(
                "--discard takes data away", hint="say why, for the table: --reason TEXT", code=Code.OPTIONS
            )
        if self.discard and (self.rerun or self.only or self.accept_changes):
            raise UsageError(
                "--discard runs nothing", hint="leave --rerun, --only and --accept-changes out", code=Code.OPTIONS
            )
        if self.reason and not (self.discard or self.rerun):
            raise UsageError("--reason is why trials are discarded or run again", hint="name them", code=Code.OPTIONS)
