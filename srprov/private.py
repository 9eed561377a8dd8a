"""Files and folders that only their owner can read: records, plans, caches. Touches the file system."""

from __future__ import annotations

import contextlib
import errno
import itertools
import json
import os
import re
import secrets
import stat
from collections.abc import Iterable
from pathlib import Path
from typing import BinaryIO, TextIO

_OTHERS = 0o077
_OF_THE_KERNEL = re.compile("/dev|/dev/pts|/proc/.*")
"""Folders whose links only the kernel and root make: /dev/stdout, /dev/fd/63. Everybody may in /dev/shm."""


def cache_folder() -> Path:
    """Return where what can be made again is kept: `$XDG_CACHE_HOME/srprov`, else `~/.cache/srprov`."""
    named = os.environ.get("XDG_CACHE_HOME", "")
    base = Path(named) if named.startswith("/") else Path(os.environ.get("HOME", "/nonexistent")) / ".cache"
    return base / "srprov"


def state_folder() -> Path:
    """Return where runs and what is known of them are kept: the XDG base directory specification's, of the user."""
    state = os.environ.get("XDG_STATE_HOME", "")
    return Path(state if os.path.isabs(state) else os.path.expanduser("~/.local/state")) / "srprov"


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
    about = folder.lstat()
    if not stat.S_ISLNK(about.st_mode) and about.st_uid == os.geteuid() and stat.S_IMODE(about.st_mode) & _OTHERS:
        folder.chmod(stat.S_IMODE(about.st_mode) & ~_OTHERS)


def replace_file(path: Path, content: str | bytes) -> None:
    """Write a file beside its place, then put it there: whoever reads it finds the old one or the whole new one.

    Its folder is made when it is missing, and on failure nothing is left beside it. Nothing waits for the disk: a power
    cut right afterwards may lose the file.

    Raises:
        OSError: It cannot be written.
    """
    make_folder(path.parent)
    _replace(path, content.encode("utf-8", "replace") if isinstance(content, str) else content)


def replace_json(path: Path, document: object) -> None:
    """Write a document as `replace_file` does, a piece at a time: as one text, a long one takes several times its size.

    Raises:
        OSError: It cannot be written.
    """
    make_folder(path.parent)
    pieces = json.JSONEncoder(indent=2).iterencode(document)
    _replace(path, (piece.encode("ascii") for piece in itertools.chain(pieces, "\n")))


def write_output(path: str, content: bytes) -> None:
    """Write a file that the user named, as `replace_file` does, or to the pipe or device that it is.

    Others may be able to write to its folder: neither a link nor a pipe of theirs takes the content.

    Raises:
        OSError: It cannot be written.
    """
    if not _is_stream(path):
        return _replace(Path(path), content)
    with open(path, "wb", opener=_open_stream) as stream:
        stream.write(content)


def open_output(path: str) -> TextIO:
    """Open a file that the user named, by the rules of `write_output`, to write text to it as it comes.

    Raises:
        OSError: It cannot be written.
    """
    if _is_stream(path):
        return open(path, "w", encoding="utf-8", opener=_open_stream)
    beside = _beside(Path(path))
    stream = open(path, "w", encoding="utf-8", opener=lambda _path, _flags: _new(beside))  # noqa: SIM115 - the caller closes it
    try:
        beside.replace(path)
    except BaseException:
        stream.close()
        beside.unlink()
        raise
    return stream


def _is_stream(path: str) -> bool:
    """Return whether a path is a pipe or device of the user's, or one of the kernel's links to what a process has open.

    Any other link is replaced as a file is: with a project that was cloned come links of a stranger's. So is a device
    elsewhere, which root's tar makes of what an archive says: it may be a disk.
    """
    try:
        about = os.lstat(path)
    except FileNotFoundError:
        return False
    if any(kind(about.st_mode) for kind in (stat.S_ISLNK, stat.S_ISBLK, stat.S_ISCHR)):
        of_the_kernel = bool(_OF_THE_KERNEL.fullmatch(os.path.realpath(os.path.dirname(path))))
        if stat.S_ISLNK(about.st_mode) or not of_the_kernel:
            return of_the_kernel
    return about.st_uid in (0, os.geteuid()) and not stat.S_ISREG(about.st_mode) and not stat.S_ISDIR(about.st_mode)


def _open_stream(path: str, _flags: int) -> int:
    about = os.lstat(path)
    is_link = stat.S_ISLNK(about.st_mode)
    flags = os.O_WRONLY | os.O_NOCTTY | os.O_CLOEXEC | (os.O_TRUNC if is_link else os.O_NOFOLLOW | os.O_NONBLOCK)
    try:
        descriptor = os.open(path, flags)
    except OSError as error:
        if error.errno != errno.ENXIO:
            raise
        # to wait for who reads it may be for ever, and a pipe may be a stranger's, of an archive
        raise OSError(errno.ENXIO, "it is a pipe that no program reads: start that first", path) from None
    os.set_blocking(descriptor, True)
    if not is_link and stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise OSError(errno.EEXIST, "somebody put a file there meanwhile", path)
    return descriptor


def _replace(path: Path, content: bytes | Iterable[bytes]) -> None:
    beside = _beside(path)
    try:
        with open(_new(beside), "wb") as stream:
            stream.writelines([content] if isinstance(content, bytes) else content)
        beside.replace(path)
    except BaseException:
        with contextlib.suppress(OSError):
            beside.unlink()
        raise


def rewrite(name: str, content: bytes, folder: int) -> None:
    """Give a file that is there another content, as `replace_file` does; permissions and owner stay.

    All is done in its folder, which is open: a link that others put in the place of that one leads nothing elsewhere.

    Raises:
        OSError: It is no file, or a link, or cannot be written.
    """
    beside = f"{name[:200]}.{secrets.token_hex(4)}.part"
    about = os.lstat(name, dir_fd=folder)
    if not stat.S_ISREG(about.st_mode):
        raise OSError(errno.EINVAL, "it is no file", name)
    try:
        with open(_new(Path(beside), folder), "wb") as stream:
            stream.write(content)
            if (about.st_uid, about.st_gid) != (os.geteuid(), os.getegid()):
                os.fchown(stream.fileno(), about.st_uid, about.st_gid)
            os.fchmod(stream.fileno(), stat.S_IMODE(about.st_mode))
        os.replace(beside, name, src_dir_fd=folder, dst_dir_fd=folder)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(beside, dir_fd=folder)
        raise


def _beside(path: Path) -> Path:
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    return path.with_name(f"{path.name[:200]}.{secrets.token_hex(4)}.part")


def _new(path: Path, folder: int | None = None) -> int:
    """Make a file that was not there, and that is no link to another; a relative path begins at an open folder."""
    return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600, dir_fd=folder)


def check_output(path: str) -> None:
    """Find out whether `write_output` could write a file; nothing is written to it.

    Raises:
        OSError: It could not.
    """
    if not _is_stream(path):
        beside = _beside(Path(path))
        os.close(_new(beside))
        beside.unlink()


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


def open_new(path: str | os.PathLike[str]) -> BinaryIO:
    """Open a file that is not there yet, for writing.

    Raises:
        OSError: It is there, or cannot be made.
    """
    return open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o600), "wb")
