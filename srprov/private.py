"""Files and folders that only their owner can read: records, plans, caches. Touches the file system."""

from __future__ import annotations

import contextlib
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


def replace_file(path: Path, text: str) -> None:
    """Write a text file beside its place, then put it there: whoever reads it finds the old one or the whole new one.

    Its folder is made when it is missing, and on failure nothing is left beside it. Nothing waits for the disk: a power
    cut right afterwards may lose the file.

    Raises:
        OSError: It cannot be written.
    """
    make_folder(path.parent)
    beside = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        write_file(beside, text)
        beside.replace(path)
    except BaseException:
        with contextlib.suppress(OSError):
            beside.unlink()
        raise


def write_file(path: str | Path, text: str, flags: int = os.O_TRUNC) -> None:
    """Write a text file; one that was there before loses its wider permissions. `flags` may be O_APPEND instead.

    What UTF-8 cannot hold, half of a surrogate pair, becomes a question mark.

    Raises:
        OSError: It cannot be written.
    """
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | flags, 0o600)
    with open(descriptor, "w", encoding="utf-8", errors="replace") as stream:
        if stat.S_ISREG(os.fstat(stream.fileno()).st_mode):  # not a pipe or a device
            os.fchmod(stream.fileno(), 0o600)
        stream.write(text)
