"""Files and folders that only their owner can read: records, plans, caches. Touches the file system."""

from __future__ import annotations

import os
import stat
from pathlib import Path

_OTHERS = 0o077


def make_folder(path: Path) -> None:
    """Make a folder and those above it that are missing, each for its owner alone.

    One that is there already is narrowed when it is the user's own `srprov`, which nobody else has a part in.
    """
    for folder in reversed((path, *path.parents)):
        if not folder.exists():
            folder.mkdir(mode=0o700, exist_ok=True)
        elif folder.name == "srprov":
            _narrow(folder)


def _narrow(folder: Path) -> None:
    about = folder.stat()
    if about.st_uid == os.geteuid() and stat.S_IMODE(about.st_mode) & _OTHERS:
        folder.chmod(stat.S_IMODE(about.st_mode) & ~_OTHERS)


def write_file(path: str | Path, text: str, flags: int = os.O_TRUNC) -> None:
    """Write a text file; one that was there before loses its wider permissions. `flags` may be O_APPEND instead.

    Raises:
        OSError: It cannot be written.
    """
    with open(os.open(path, os.O_WRONLY | os.O_CREAT | flags, 0o600), "w", encoding="utf-8") as stream:
        if stat.S_ISREG(os.fstat(stream.fileno()).st_mode):  # not a pipe or a device
            os.fchmod(stream.fileno(), 0o600)
        stream.write(text)
