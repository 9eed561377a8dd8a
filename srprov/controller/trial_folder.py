"""The folder of a run of trials: for a new run it is empty, and nobody else can look into it."""

from __future__ import annotations

import contextlib
import fcntl
import os
import stat
from collections.abc import Iterator, Sequence
from pathlib import Path

from srprov import believed, private, regular_file
from srprov.codes import Code
from srprov.errors import RefusedError, UsageError
from srprov.record import default_root
from srprov.whose import others_may_write

_RESUME = "go on with the run in it by --resume, or name another folder"


def of_runs() -> Path:
    """Return where the folders are of runs that name none."""
    return default_root().parent / "trials"


def check_new(folder: Path, used_hint: str = _RESUME) -> None:
    """Refuse a folder for a new run that has something in it, that leads elsewhere, or that cannot be made.

    Raises:
        UsageError: So it is.
        RefusedError: It is there, and another user's or writable by others.
    """
    try:
        used = folder.exists() and any(folder.iterdir())
        near = next(one for one in (folder, *folder.absolute().parents) if os.path.lexists(one))
        usable = near.is_dir() and os.access(near, os.W_OK | os.X_OK)
    except OSError as error:
        raise UsageError(
            f"{folder}: {error.strerror}", hint="name another folder with -o", code=Code.CANNOT_WRITE
        ) from None
    if used:
        raise UsageError(f"{folder} is not empty", hint=used_hint, code=Code.IN_THE_WAY)
    if folder.is_symlink():
        raise UsageError(f"{folder} is a link", hint="name the folder itself with -o", code=Code.STRANGE_FILE)
    if folder.exists():
        check_own(folder, ())
    if not usable:
        why = "you may not write there" if near.is_dir() else "it is no folder"
        raise UsageError(
            f"nothing can be kept in {near}: {why}", hint="name another folder with -o", code=Code.CANNOT_WRITE
        )


def make_folder(folder: Path) -> None:
    """Make the folder of a new run.

    Raises:
        UsageError: It cannot be made.
        RefusedError: Others may write to it, or put a link into it since it was checked.
    """
    try:
        # whoever writes to it could put a link in the place of what is written next
        (believed if default_root().parent in folder.parents else private).make_folder(folder)
        (folder / "trials").mkdir(mode=0o700)
    except OSError as error:
        raise UsageError(
            f"cannot make {folder}: {error.strerror}", hint="name another folder with -o", code=Code.CANNOT_WRITE
        ) from None
    check_own(folder)


def check_own(folder: Path, inside: Sequence[str] = ("trials",)) -> None:
    """Refuse to go on in a folder in which others may have put links, or with links in it: they would lead elsewhere.

    A folder that came by `git clone` or `tar` is the user's own, and its links are a stranger's. srprov makes none.

    Raises:
        RefusedError: There is a link; or it, or a named folder in it, is another user's or writable by others.
        UsageError: There is none, or it cannot be looked through.
    """
    for one in (folder, *(folder / name for name in inside)):
        try:
            about = os.lstat(one)
        except OSError as error:
            raise UsageError(
                f"{one}: {error.strerror}", hint="name a folder that srprov made", code=Code.NO_FILE
            ) from None
        if not stat.S_ISDIR(about.st_mode) or about.st_uid != os.geteuid() or others_may_write(one, about):
            hint = "go on only with what is your own, in a folder that nobody else can write to"
            raise RefusedError(
                f"{one} is a link, somebody else's, or writable by others", hint=hint, code=Code.STRANGE_FILE
            )
    try:
        link = next(_links(folder), "")
    except OSError as error:
        raise UsageError(
            f"{error.filename}: {error.strerror}", hint="name a folder that srprov made", code=Code.NO_FILE
        ) from None
    if link:
        raise RefusedError(
            f"{link}, and srprov makes none", hint="remove it, or name another folder", code=Code.STRANGE_FILE
        )


def _links(folder: Path) -> Iterator[str]:
    """Yield in words what is a link below a folder, at any depth, or neither a file nor a folder.

    What came in part is gone on with, and the journal too: by another name (a hard link), which an archive may have
    given a file of the user's here, that one would be written to. So would a disk, whose device root's tar makes.
    """
    left = [os.fspath(folder)]
    while left:
        with os.scandir(left.pop()) as entries:
            for one in entries:
                if one.is_symlink():
                    yield f"{one.path} is a link"
                elif one.is_dir(follow_symlinks=False):
                    left.append(one.path)
                elif not one.is_file(follow_symlinks=False):
                    yield f"{one.path} is a device, pipe or socket"
                elif regular_file.has_further_names(one.stat(follow_symlinks=False)):
                    yield f"{one.path} has another name (a hard link)"


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
        raise UsageError(
            f"another srprov works in {folder}", hint="wait until it has ended", code=Code.LOCKED
        ) from None
    try:
        yield
    finally:
        os.close(descriptor)


@contextlib.contextmanager
def opened(folder: Path) -> Iterator[Path]:
    """Give another name for the folder, by which it is the same one to the end; errors tell its own.

    Whoever may write to the folder above could put a link in its place.
    """
    with believed.to_fill(str(folder)) as name:
        try:
            yield Path(name)
        except UsageError as error:
            raise UsageError(error.message.replace(name, str(folder)), hint=error.hint, code=error.code) from error
        except OSError as error:
            error.filename = str(error.filename or folder).replace(name, str(folder))
            raise
