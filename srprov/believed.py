"""What srprov keeps and believes later: settings and trees of git, playbooks as code, tokens, what was hashed or built.

Such a file or folder counts only where nobody else can have put it: it and all up to the user's `srprov` are the user's
and no links, and no folder above is another user's, or one that others may write to (but /tmp and the like). Touches
the file system.
"""

from __future__ import annotations

import contextlib
import errno
import os
import stat
from collections.abc import Iterator
from pathlib import Path

from srprov import private
from srprov.whose import others_may_write

_MOST_LINKS = 40
"""Of one path, as Linux follows."""


def read(path: Path, most: int) -> bytes:
    """Return up to `most` bytes of a file that srprov keeps, to be believed: its folder is as of `is_safe_folder`.

    Raises:
        OSError: It cannot be read; or somebody else may have written it, or put a link in its place.
    """
    if not is_safe_folder(path.parent) or not _is_own(path) or not stat.S_ISREG(path.lstat().st_mode):
        raise PermissionError(errno.EPERM, "it may be somebody else's", str(path))
    with open(path, "rb", opener=lambda name, flags: os.open(name, flags | os.O_NOFOLLOW)) as file:
        return file.read(most)


def check(folder: Path) -> None:
    """Refuse a folder that srprov keeps, and whose content is believed, when it is not as of `is_safe_folder`.

    Raises:
        OSError: It is not there; or somebody else may have put something into it, or have put it there.
    """
    if not is_safe_folder(folder):
        raise _refused(folder)


def _refused(folder: Path) -> PermissionError:
    return PermissionError(errno.EPERM, "others may write to it, or to a folder above it", str(folder))


def make_folder(folder: Path) -> None:
    """Make a folder as `private.make_folder` does, and refuse it as `check` does, before anything is made.

    Raises:
        OSError: As `check`; or it cannot be made.
    """
    make_reached(folder)
    check(folder)


def make_reached(folder: Path) -> None:
    """Make a folder as `make_folder` does, for what is compared when it is read: the user's links may lead there.

    Raises:
        OSError: Somebody else may have put a link on its way; or it cannot be made.
    """
    there = next(one for one in (folder, *folder.parents) if os.path.lexists(one))
    if not is_out_of_reach(there):
        raise _refused(there)
    private.make_folder(folder)
    if not is_out_of_reach(folder):
        raise _refused(folder)


def is_safe_folder(folder: Path) -> bool:
    """Return whether nobody else can write to a folder below the user's `srprov`, or put another one in its place.

    The owner of a file alone says too little: in a folder of somebody else's a link may lead to a file that the user
    owns, and that a stranger wrote, such as one of a repository that was cloned.

    Raises:
        OSError: It cannot be looked at.
    """
    own = [folder]
    while own[-1].name != "srprov" and "srprov" in own[-1].parts:
        own.append(own[-1].parent)
    return all(map(_is_own, own)) and is_out_of_reach(folder)


def is_out_of_reach(path: str | os.PathLike[str]) -> bool:
    """Return whether nobody else can put another file in a path's place: others own no folder above, nor write to one.

    A link's folder counts wherever it is, also that of a link that another link leads to.

    Raises:
        OSError: It cannot be looked at.
    """
    return all(_is_nobody_elses(one, about) for one, about in _on_the_way(path))


def is_closed(path: str | os.PathLike[str]) -> bool:
    """Return whether nobody else can write to a file or folder, or put another one in its place.

    Raises:
        OSError: It cannot be looked at.
    """
    return is_out_of_reach(path) and not others_may_write(path, os.stat(path))


def _on_the_way(path: str | os.PathLike[str]) -> Iterator[tuple[str, os.stat_result]]:
    """Yield each folder and link that the kernel goes through to a path, and what is there in the end."""
    at, left, links = "/", [*reversed(Path.cwd().joinpath(path).parts)], 0
    while left:
        part = left.pop()
        at = "/" if part == "/" else os.path.dirname(at) if part == ".." else os.path.join(at, part)
        about = os.lstat(at)
        yield at, about
        if stat.S_ISLNK(about.st_mode):
            links += 1
            if links > _MOST_LINKS:
                raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), os.fspath(path))
            left += reversed(Path(os.readlink(at)).parts)
            at = os.path.dirname(at)


def _is_own(path: Path) -> bool:
    about = path.lstat()
    return about.st_uid == os.geteuid() and not stat.S_ISLNK(about.st_mode) and not about.st_mode & 0o022


def _is_nobody_elses(path: str, about: os.stat_result) -> bool:
    """Return whether a folder or link is the user's or root's, and others cannot take away what is in it."""
    if stat.S_ISLNK(about.st_mode) or about.st_mode & stat.S_ISVTX:
        return about.st_uid in (0, os.geteuid())
    return not others_may_write(path, about)


@contextlib.contextmanager
def to_fill(folder: str) -> Iterator[str]:
    """Give a name for a folder that is the same one to the end, whatever others put in the place of its path.

    Raises:
        OSError: It is a link, or not there; or others may write to it, who could put links where something is written.
    """
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        name = f"/proc/self/fd/{descriptor}"
        if others_may_write(name, os.fstat(descriptor)):
            raise PermissionError(errno.EPERM, "others may write to it", folder)
        yield name
    finally:
        os.close(descriptor)


def write(path: Path, content: str, most: int) -> None:
    """Write a file as `private.replace_file` does, and make its folder: where `read` will believe it, or not at all.

    What is longer than the `most` that is read of it would be forgotten with all that stood there before; robots' words
    may be in it.

    Raises:
        OSError: It cannot be written, or is longer; or its folder is refused by `check`.
    """
    if len(content.encode()) > most:
        raise OSError(errno.EFBIG, f"it would have more than the {most >> 10} KiB that are read of it", str(path))
    make_folder(path.parent)
    private.replace_file(path, content)
