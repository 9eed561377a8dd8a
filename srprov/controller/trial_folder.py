"""The folder of a run of trials: for a new run it is empty, and nobody else can look into it."""

from __future__ import annotations

import contextlib
import fcntl
import os
import stat
from collections.abc import Iterator, Sequence
from pathlib import Path

from srprov import private
from srprov.errors import RefusedError, UsageError

_RESUME = "go on with the run in it by --resume, or name another folder"


def check_new(folder: Path, used_hint: str = _RESUME) -> None:
    """Refuse a folder for a new run that has something in it, or that cannot be made.

    Raises:
        UsageError: So it is.
    """
    try:
        used = folder.exists() and any(folder.iterdir())
        near = next(one for one in (folder, *folder.absolute().parents) if os.path.lexists(one))
        usable = near.is_dir() and os.access(near, os.W_OK | os.X_OK)
    except OSError as error:
        raise UsageError(f"{folder}: {error.strerror}", hint="name another folder with -o") from None
    if used:
        raise UsageError(f"{folder} is not empty", hint=used_hint)
    if not usable:
        why = "you may not write there" if near.is_dir() else "it is no folder"
        raise UsageError(f"nothing can be kept in {near}: {why}", hint="name another folder with -o")


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


def check_own(folder: Path, inside: Sequence[str] = ("trials",)) -> None:
    """Refuse to go on in a folder, and some in it, in which others may have put links: they would lead elsewhere.

    Raises:
        RefusedError: One of them is a link, another user's, or writable by others.
        UsageError: There is none.
    """
    for one in (folder, *(folder / name for name in inside)):
        try:
            about = os.lstat(one)
        except OSError as error:
            raise UsageError(f"{one}: {error.strerror}", hint="name a folder that srprov made") from None
        if not stat.S_ISDIR(about.st_mode) or about.st_uid != os.geteuid() or about.st_mode & 0o022:
            hint = "go on only with what is your own, in a folder that nobody else can write to"
            raise RefusedError(f"{one} is a link, somebody else's, or writable by others", hint=hint)


@contextlib.contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Keep any other srprov out of a folder; whoever dies lets go of it.

    Raises:
        UsageError: Another one works in it.
        OSError: It is gone.
    """
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise UsageError(f"another srprov works in {folder}", hint="wait until it has ended") from None
    try:
        yield
    finally:
        os.close(descriptor)
