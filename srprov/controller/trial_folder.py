"""The folder of a run of trials: for a new run it is empty, and nobody else can look into it."""

from __future__ import annotations

from pathlib import Path

from srprov import private
from srprov.errors import UsageError


def check_empty(folder: Path) -> None:
    """Refuse a folder for a new run that has something in it.

    Raises:
        UsageError: It has, or cannot be read.
    """
    try:
        used = folder.exists() and any(folder.iterdir())
    except OSError as error:
        raise UsageError(f"{folder}: {error.strerror}", hint="name another folder with -o") from None
    if used:
        hint = "go on with the run in it by --resume, or name another folder"
        raise UsageError(f"{folder} is not empty", hint=hint)


def make_folder(folder: Path) -> None:
    """Make the folder of a new run.

    Raises:
        UsageError: It cannot be made.
    """
    try:
        private.make_folder(folder)
        (folder / "trials").mkdir(mode=0o700)
    except OSError as error:
        raise UsageError(f"cannot make {folder}: {error.strerror}", hint="name another folder with -o") from None
