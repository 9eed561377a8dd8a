"""What robots give, kept below one folder under names that can do no harm: logs, and files that come in parts.

Writes plain files and folders of their own, for their owner alone. Nothing is written outside of the folder.
"""

from __future__ import annotations

import errno
import functools
import hashlib
import os
import stat
from collections.abc import Collection, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import BinaryIO, TextIO

import msgspec

from srprov import private
from srprov.definitions.model import makes_repository
from srprov.secret import redact_lines

MOST_LOG = 1 << 30
"""Bytes of a container's log that come home, with the engine's times."""
_PIECE = 1 << 20
_LONGEST_LINE = 1 << 20
"""Characters; nobody looks at more of one."""
_UNSAFE = frozenset('%\\:*?"<>|')
"""What some file system has no name with; `%` begins what stands for another character."""
DEEPEST = 100
"""Folders above a file; what lies deeper is listed, and stays where it is."""
MOST_FOLDERS = 100_000
"""Of one result; each costs about a KiB of memory."""
_MOST_SYNCED = 1000
"""Files that are synced one by one; with more, the whole disk is quicker."""
_SYNCED_AT_ONCE = 16
"""The disk writes down together what is waited for at the same time: 500 small files take a tenth of the time."""
_LONGEST_NAME = 200
"""Bytes; file systems take 255, and `.part` and a number may be added."""


class Kept(msgspec.Struct, frozen=True, kw_only=True):
    """One entry of a result."""

    path: str
    """As the robot has it, relative to the result."""
    name: str = ""
    """Where it is now, relative to the folder; empty: it was not made."""
    size: int = 0
    sha256: str = ""
    note: str = ""
    """Why it was not made, or what else is to be said of it."""
    failed: bool = False
    """It should be here, and is not."""
    unclosed: str = ""
    """What is wrong with a recording that its recorder did not close."""
    recovered: str = ""
    """Where what could be read of it is, with an end, beside it."""


class LogTooLong(Exception):
    """A log has more than is brought home of one; what is here is its beginning."""


class TooManyFolders(Exception):
    """A result has more folders than are made here."""


def write_log(lines: Iterator[str], path: Path) -> None:
    """Write a log, anew if it was begun before; secrets are taken out of it.

    Raises:
        LogTooLong: It has more than `MOST_LOG` bytes.
        OSError: It cannot be written.
    """
    private.make_folder(path.parent)
    part = path.with_name(f"{path.name}.part")
    part.unlink(missing_ok=True)
    left = MOST_LOG
    with private.open_new(part) as stream:
        for line in redact_lines(lines):
            data = line.encode("utf-8", "replace") + b"\n"
            left -= len(data)
            if left < 0:
                break
            stream.write(data)
    part.replace(path)  # what an earlier call brought stays until there is a new one
    if left < 0:
        raise LogTooLong(f"its log has more than {MOST_LOG >> 20} MiB")


def log_lines(path: Path) -> Iterator[tuple[str, str]]:
    """Return the engine's time and the text of each line of a log that was written here."""
    with path.open(encoding="utf-8", errors="replace", newline="\n") as stream:
        yield from timed_lines(stream)


def timed_lines(stream: TextIO) -> Iterator[tuple[str, str]]:
    """Return the same of an open log; of a line that is very long, only how it begins."""
    begins = True
    while part := stream.readline(_LONGEST_LINE):
        if begins:
            when, _, text = part.rstrip("\n").partition(" ")
            yield when, text
        begins = part.endswith("\n")


def is_safe_name(path: str) -> bool:
    """Return whether a file of this path is kept under just that."""
    return all(_part(part, folder=True) == part for part in path.strip("/").split("/"))


class Names:
    """The names in a folder that is made here: each is harmless, and no two are the same even where case is not."""

    __slots__ = ("_folders", "_last", "_made", "_names", "_used")

    def __init__(self) -> None:
        self._folders: dict[str, Names] = {}
        self._names: dict[str, str] = {}
        self._used: set[str] = set()
        self._last: dict[str, int] = {}
        """Name without case -> the last number that was given for it."""
        self._made = 0
        """Folders at any depth; counted where names are asked for."""

    def name(self, parts: list[str]) -> str:
        """Return where a file is put: each part of its path under a name of its own.

        Raises:
            TooManyFolders: They are more than `MOST_FOLDERS`.
        """
        folder, names = self, []
        for part in parts[:-1]:
            names.append(folder._own(part, folder=True))
            if part not in folder._folders:
                self._made += 1
                if self._made > MOST_FOLDERS:
                    raise TooManyFolders(f"it has more than {MOST_FOLDERS} folders")
                folder._folders[part] = Names()
            folder = folder._folders[part]
        return "/".join([*names, folder._own(parts[-1], folder=False)])

    def _own(self, part: str, *, folder: bool) -> str:
        if part not in self._names:
            name = safe = _part(part, folder=folder)
            number = self._last.get(safe.casefold(), 1)
            while name.casefold() in self._used:
                number += 1
                name = f"{safe}%{number}"
            self._last[safe.casefold()] = number
            self._used.add(name.casefold())
            self._names[part] = name
        return self._names[part]


def _part(part: str, *, folder: bool) -> str:
    safe = "".join(one if one.isprintable() and one not in _UNSAFE else _escaped(one) for one in part)
    if safe.strip(". ") == "":
        safe = safe.replace(".", "%2E").replace(" ", "%20")
    if makes_repository(safe, folder=folder):
        safe = f"%{ord(safe[0]):02X}{safe[1:]}"
    data = safe.encode()
    if len(data) > _LONGEST_NAME:
        safe = data[: _LONGEST_NAME - 17].decode("utf-8", "ignore") + "%" + hashlib.sha256(data).hexdigest()[:16]
    return safe


@functools.lru_cache(maxsize=4096)
def _escaped(one: str) -> str:
    """Return a character's bytes, as they were on the robot, in the form `%XX`."""
    data = one.encode("utf-8", "surrogateescape" if "\udc80" <= one <= "\udcff" else "surrogatepass")
    return "".join(f"%{byte:02X}" for byte in data)


def is_here(place: Path, size: int, sha256: str) -> bool:
    """Return whether a file of this content is there already."""
    try:
        with os.fdopen(os.open(place, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb") as stream:
            about = os.fstat(stream.fileno())
            same = stat.S_ISREG(about.st_mode) and about.st_size == size
            return same and hash_of(stream).hexdigest() == sha256
    except OSError:
        return False


def hash_of(stream: BinaryIO) -> hashlib._Hash:
    """Return the sha256 of what is left of a file; more can be added to it."""
    digest = hashlib.sha256()
    while piece := stream.read(_PIECE):
        digest.update(piece)
    return digest


def open_part(path: Path, whole: int = 0) -> tuple[BinaryIO, hashlib._Hash]:
    """Open what is here of a file, for writing at its end, with the hash of it.

    Args:
        path: The part.
        whole: Only whole pieces of so many bytes count, as what came last may not have reached the disk; 0: none do.
    """
    flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | (0 if whole else os.O_TRUNC)
    try:
        descriptor = os.open(path, flags, 0o600)
    except FileNotFoundError:
        private.make_folder(path.parent)
        descriptor = os.open(path, flags, 0o600)
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise OSError(errno.EEXIST, "a device, pipe or socket is there", os.fspath(path))
    stream = os.fdopen(descriptor, "r+b")
    if not whole:
        return stream, hashlib.sha256()
    stream.truncate(os.fstat(stream.fileno()).st_size // whole * whole)
    return stream, hash_of(stream)


def put(part: Path, place: Path) -> None:
    """Put a whole file in its place, instead of what is there; its folders are made.

    Raises:
        OSError: A folder is there, or a file stands where a folder should be.
    """
    try:
        part.replace(place)
    except FileNotFoundError:
        place.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        part.replace(place)


def sync(places: Collection[Path]) -> None:
    """Return when files have reached the disk."""
    if len(places) > _MOST_SYNCED:
        os.sync()
        return
    with ThreadPoolExecutor(_SYNCED_AT_ONCE) as pool:
        for done in [pool.submit(_sync, place) for place in places]:
            done.result()


def _sync(place: Path) -> None:
    with place.open("rb") as stream:
        os.fsync(stream.fileno())
