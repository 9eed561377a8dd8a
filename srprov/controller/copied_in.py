"""Files here -> a tar for a container, made while it is sent.

Takes the path of a file or folder; gives pieces of bytes. Reads files through `regular_file`, follows only a link that
the user named, and changes nothing.
"""

from __future__ import annotations

import functools
import os
import stat
import tarfile
from collections.abc import Generator, Iterator

import msgspec

from srprov import regular_file, secret_files
from srprov.codes import Code
from srprov.controller.copied import Copied
from srprov.definitions.own_lines import is_users_own
from srprov.definitions.version_control import is_from_elsewhere, names_in
from srprov.errors import UsageError

_BLOCK = 512
_PIECE = 1 << 20
_CHANGED = "it changed while it was read"
_OWN = (
    "a file of your own that you did not name: a secret's, a key, an inventory's or version control's; or a copy "
    "of its own is needed, as it has another name elsewhere (a hard link)"
)


class Owner(msgspec.Struct, frozen=True):
    """Whose files are in the container; numbers, since names there are not those here."""

    user: int = 0
    group: int = 0


class _Named:
    """What the user named, and whether a file is meant by that: a project's links, and second names, are a stranger's.

    So a file of the user's own goes only by its own name, not by one that a clone or an archive gave it.
    """

    def __init__(self, path: str) -> None:
        """Take the path as it was named."""
        link = next(regular_file.links_in(path), "")
        self._linked, self.real = bool(link), os.path.realpath(path)
        # one file of a relative path may have been unpacked beside what it is a second name of
        self._alone = not os.path.isabs(path) and not os.path.isdir(path)
        self._root = self.real if not link and os.path.isdir(path) else os.path.realpath(os.path.dirname(link or path))
        self._names = functools.cache(names_in)
        self._secrets = functools.cache(secret_files.known)  # for all files below, and only where one is asked for

    def means(self, file: str, about: os.stat_result) -> bool:
        """Return whether it means a file, which lies there or below; `about` is the file's."""
        if not self._linked and not regular_file.has_further_names(about):
            return True
        if self._alone and regular_file.has_further_names(about):
            return False
        return not is_users_own(file, self._root, self._secrets())

    def means_link(self, about: os.stat_result) -> bool:
        """Return whether it means a link that lies there or below: no archive gave it that name."""
        return not is_from_elsewhere(about, self._root, self._names)


def tar_of(path: str, name: str, owner: Owner, copied: Copied) -> Iterator[bytes]:
    """Yield a file, or a folder and all below it, as a tar.

    Args:
        path: What is sent; a link is followed here, and nowhere below.
        name: What it is called in the tar; empty: the content of a folder.
        owner: Whose it is there.
        copied: Is told what was sent, and what was left out.

    Raises:
        UsageError: Something cannot be read, or changes meanwhile.
    """
    try:
        yield from _any(_Named(path), name, owner, copied)
    except OSError as error:  # the engine's client would take it for the connection's
        raise UsageError(f"{error.filename or path}: {error.strerror or error}", code=Code.NO_FILE) from error
    yield bytes(2 * _BLOCK)


def _any(named: _Named, name: str, owner: Owner, copied: Copied) -> Iterator[bytes]:
    left = [(named.real, name)]
    while left:  # folders lie as deep as a path is long, which is deeper than functions may call each other
        path, name = left.pop()
        about = os.stat(path, follow_symlinks=False)
        if stat.S_ISDIR(about.st_mode):
            below = yield from _folder(path, name, owner, named, copied)
            left += [(os.path.join(path, one), os.path.join(name, one)) for one in reversed(below)]
        elif stat.S_ISREG(about.st_mode) and not named.means(path, about):
            copied.leave_out(path, _OWN)
        elif stat.S_ISREG(about.st_mode):
            yield from _file(path, name, owner, copied)
        else:
            copied.leave_out(path, "a device, pipe or socket")


def _folder(path: str, name: str, owner: Owner, named: _Named, copied: Copied) -> Generator[bytes, None, list[str]]:
    """Yield a folder and the links in it; return what else is in it."""
    with regular_file.real_folder(path) as descriptor:
        if name:
            yield _header(name, os.fstat(descriptor), owner, tarfile.DIRTYPE)
        below = sorted(os.listdir(descriptor))
        links = [one for one in below if _is_link(one, descriptor)]
        for one in links:
            about = os.stat(one, dir_fd=descriptor, follow_symlinks=False)
            if named.means_link(about):
                leads_to = os.readlink(one, dir_fd=descriptor)
                yield _header(os.path.join(name, one), about, owner, tarfile.SYMTYPE, leads_to)
            else:
                copied.leave_out(os.path.join(path, one), _OWN)
    return [one for one in below if one not in links]


def _is_link(name: str, folder: int) -> bool:
    return stat.S_ISLNK(os.stat(name, dir_fd=folder, follow_symlinks=False).st_mode)


def _file(path: str, name: str, owner: Owner, copied: Copied) -> Iterator[bytes]:
    with regular_file.real_file(path) as stream:
        about = os.fstat(stream.fileno())
        yield _header(name, about, owner, tarfile.REGTYPE)
        left = about.st_size
        while left:
            piece = stream.read(min(left, _PIECE))
            if not piece:
                raise UsageError(
                    f"{path}: {_CHANGED}", hint="copy it again once nobody writes to it", code=Code.NO_FILE
                )
            left -= len(piece)
            copied.bytes += len(piece)
            yield piece
    copied.files += 1
    yield bytes(-about.st_size % _BLOCK)


def _header(name: str, about: os.stat_result, owner: Owner, kind: bytes, link: str = "") -> bytes:
    entry = tarfile.TarInfo(name)
    entry.type, entry.linkname, entry.mode = kind, link, stat.S_IMODE(about.st_mode) & 0o777
    entry.size = about.st_size if kind == tarfile.REGTYPE else 0
    entry.mtime, entry.uid, entry.gid = int(about.st_mtime), owner.user, owner.group
    return entry.tobuf(tarfile.PAX_FORMAT, "utf-8", "surrogateescape")
