"""A file that a user, or a user's file, names -> its content: a regular file within a size, or an error that says why.

Takes a path and a limit in bytes; gives bytes or text. Reads files. A path may lead to a pipe that nobody writes to, to
a device that never ends, or to a sparse file larger than memory: none of them may hang srprov or fill its memory. All
files that srprov did not write itself are read here; tests/test_reads.py holds every other file to that.
"""

from __future__ import annotations

import contextlib
import errno
import itertools
import os
import stat
from collections.abc import Callable, Iterable, Iterator
from typing import BinaryIO

MIB = 1024 * 1024
VARIABLES = ("group_vars", "host_vars")
"""Folders of variables, which are read with an inventory beside them."""
WHOLE = "# No group_vars and no host_vars are read with this file, until you take this line away."
"""What an inventory says that srprov wrote: a project that was cloned may bring some beside it later."""
CHANGED = "it changed while it was read: run the command again"
_PIECE = MIB
_MOST_BESIDE = 1000
_KINDS = (
    (stat.S_ISLNK, errno.ELOOP, CHANGED),
    (stat.S_ISDIR, errno.EISDIR, os.strerror(errno.EISDIR)),
    (stat.S_ISFIFO, errno.EINVAL, "it is a pipe, not a file"),
    (stat.S_ISSOCK, errno.EINVAL, "it is a socket, not a file"),
    (lambda mode: not stat.S_ISREG(mode), errno.EINVAL, "it is a device, not a file"),
)


def read(path: str | os.PathLike[str], most: int = 8 * MIB, *, real: bool = False) -> bytes:
    """Return the content of a file of at most `most` bytes.

    With `real`, the path had no link in it when it was checked, and has none now: else somebody put one there since.

    Raises:
        OSError: It cannot be read, is no regular file or is larger; `strerror` says so in words for the user.
    """
    return read_with_status(path, most, real=real)[0]


def read_with_status(
    path: str | os.PathLike[str], most: int = 8 * MIB, *, real: bool = False
) -> tuple[bytes, os.stat_result]:
    """Return the content as `read` does, and whose file it was that was read."""
    content, about = _begin(path, most, whole=True, real=real)
    if len(content) > most:
        raise _too_large(path, most)
    return content, about


def names_beside(path: str | os.PathLike[str]) -> list[str]:
    """Return names in the folder of a path that end as it does: one of them may be meant by what is not there.

    Of a folder with very many, only the first ones: each is compared with what was written.
    """
    folder, name = os.path.split(os.fspath(path))
    ending = os.path.splitext(name)[1]
    try:
        with os.scandir(folder or ".") as entries:
            return [one.name for one in itertools.islice(entries, _MOST_BESIDE) if one.name.endswith(ending)]
    except (OSError, ValueError):
        return []


def links_in(path: str) -> Iterator[str]:
    """Return the links that are named in a relative path, in their order; none of a path from the root."""
    named = [] if os.path.isabs(path) else itertools.accumulate(path.split("/"), os.path.join)
    return filter(os.path.islink, named)


def has_further_names(about: os.stat_result) -> bool:
    """Return whether a file, or a link, has more than one name on its disk; the kernel counts those of folders alone.

    Where a link leads is what is in it: programs keep words there that are nobody else's.
    """
    return not stat.S_ISDIR(about.st_mode) and about.st_nlink > 1


def identities(paths: Iterable[str]) -> set[tuple[int, int]]:
    """Return what the kernel knows files by, those that are there: a disk may have further names for one."""
    found = set[tuple[int, int]]()
    for path in paths:
        with contextlib.suppress(OSError, ValueError):  # it is gone
            about = os.lstat(path)
            found.add((about.st_dev, about.st_ino))
    return found


def is_one_of(path: str, paths: Iterable[str]) -> bool:
    """Return whether a file that is there is one of some, by whatever of its names."""
    return not identities([path]).isdisjoint(identities(paths))


def walk(
    top: str | os.PathLike[str], onerror: Callable[[OSError], None] | None = None
) -> Iterator[tuple[str, list[str], list[str]]]:
    """Yield a folder and all below it as `os.walk` does, however deep they are: that one calls itself for each.

    No link is followed, and names that are taken out of the folders are passed over, as is what cannot be read.
    """
    left = [os.fspath(top)]
    while left:
        parent = left.pop()
        folders, files = list[str](), list[str]()
        try:
            with os.scandir(parent) as entries:
                for one in entries:
                    (folders if _is_folder(one) else files).append(one.name)
        except OSError as error:
            if onerror is not None:
                onerror(error)
            continue
        yield parent, folders, files
        inner = (os.path.join(parent, name) for name in reversed(folders))
        left += [path for path in inner if not os.path.islink(path)]


def _is_folder(entry: os.DirEntry[str]) -> bool:
    try:
        return entry.is_dir()
    except OSError:
        return False


def read_text(path: str | os.PathLike[str], most: int = 8 * MIB, errors: str = "strict") -> str:
    """Return the content as UTF-8 text, as `read` does; `errors` as for `bytes.decode`."""
    try:
        return read(path, most).decode("utf-8", errors)
    except UnicodeDecodeError:
        raise OSError(errno.EILSEQ, "it is not UTF-8 text", os.fspath(path)) from None


def beginning(path: str | os.PathLike[str], count: int) -> bytes:
    """Return the first `count` bytes of a file of any size.

    Raises:
        OSError: It cannot be read, or is no regular file.
    """
    return _begin(path, count, whole=False)[0][:count]


@contextlib.contextmanager
def real_file(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """Open a file of any size, whose path had no link in it when it was checked, to be read piece by piece.

    Raises:
        OSError: It cannot be read, is no regular file, or there is a link in its path now.
    """
    _check(path, os.stat(path, follow_symlinks=False).st_mode)
    flags = os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY | os.O_NOFOLLOW
    with open(os.open(path, flags), "rb") as file:
        _check_real(path, file.fileno())
        _check(path, os.fstat(file.fileno()).st_mode)
        yield file


@contextlib.contextmanager
def real_folder(path: str | os.PathLike[str]) -> Iterator[int]:
    """Open a folder whose path had no link in it when it was checked; give its descriptor.

    Raises:
        OSError: It cannot be read, or there is a link in its path now.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    except NotADirectoryError:
        raise OSError(errno.ELOOP, CHANGED, os.fspath(path)) from None
    try:
        _check_real(path, descriptor)
        yield descriptor
    finally:
        os.close(descriptor)


def _check_real(path: str | os.PathLike[str], descriptor: int) -> None:
    """Refuse what was opened by way of a link: the kernel knows it by another path."""
    if os.readlink(f"/proc/self/fd/{descriptor}") != os.fspath(path):
        raise OSError(errno.ELOOP, CHANGED, os.fspath(path))


def _begin(
    path: str | os.PathLike[str], count: int, *, whole: bool, real: bool = False
) -> tuple[bytes, os.stat_result]:
    """Return up to `count` bytes, and one more when there are more; a large file is not read where all is wanted."""
    try:
        # looked at before it is opened: to open a device may already do something
        _check(path, os.stat(path, follow_symlinks=not real).st_mode)
        # a pipe that took the file's place meanwhile does not block
        flags = os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY | (os.O_NOFOLLOW if real else 0)
        descriptor = os.open(path, flags)
    except ValueError:  # a NUL, or half of a surrogate pair
        raise OSError(errno.EINVAL, "no file can have such a name") from None
    try:
        if real:
            _check_real(path, descriptor)
        about = os.fstat(descriptor)
        _check(path, about.st_mode)
        if whole and about.st_size > count:
            raise _too_large(path, count)
        pieces, left = [], count + 1  # the kernel's own files give no size, and others may grow
        at_once = max(_PIECE, about.st_size + 1)  # pieces of a large file would be in memory twice when they are joined
        while left and (piece := os.read(descriptor, min(left, at_once))):
            pieces.append(piece)
            left -= len(piece)
        return b"".join(pieces), about
    finally:
        os.close(descriptor)


def _check(path: str | os.PathLike[str], mode: int) -> None:
    for is_kind, number, words in _KINDS:
        if is_kind(mode):
            raise OSError(number, words, os.fspath(path))


def _too_large(path: str | os.PathLike[str], most: int) -> OSError:
    return OSError(errno.EFBIG, f"it is larger than {_size(most)}", os.fspath(path))


def _size(count: int) -> str:
    for unit, factor in (("MiB", MIB), ("KiB", 1024)):
        if count >= factor and count % factor == 0:
            return f"{count // factor} {unit}"
    return f"{count} bytes"


def variables_beside(folder: str | os.PathLike[str]) -> str:
    """Return the path of variables that would be read with an inventory in a folder, or nothing; links count, too."""
    beside = (os.path.join(folder, name) for name in VARIABLES)
    return next(filter(os.path.lexists, beside), "")
