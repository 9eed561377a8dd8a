"""A tar that came from a robot -> files below one folder, under names that can do no harm, and what became of each.

Takes a file that holds a tar whose hash was compared. Writes plain files and folders of their own, for their owner
alone; links are not made but listed, and what is neither is listed too. Nothing is written outside of the folder.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from srprov import private
from srprov.secret import redact_lines
from srprov.transport.tar_stream import TarStream

MOST_LOG = 1 << 30
"""Bytes of a container's log that come home, with the engine's times."""
_PIECE = 1 << 20
_MOST_FILES = 1_000_000
_UNSAFE = frozenset('%\\:*?"<>|')
"""What some file system has no name with; `%` begins what stands for another character."""
_DEEPEST = 100
"""Folders above a file; what lies deeper is listed, and stays where it is."""
_LONGEST_NAME = 200
"""Bytes; file systems take 255, and `.part` and a number may be added."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Kept:
    """One entry of a result."""

    path: str
    """As the robot has it, relative to the result."""
    name: str = ""
    """Where it is now, relative to the folder; empty: it was not made."""
    size: int = 0
    sha256: str = ""
    note: str = ""
    """Why it was not made, or what else is to be said of it."""


class LogTooLong(Exception):
    """A log has more than is brought home of one; what is here is its beginning."""


def write_log(lines: Iterator[str], path: Path) -> None:
    """Write a log, anew if it was begun before; secrets are taken out of it.

    Raises:
        LogTooLong: It has more than `MOST_LOG` bytes.
        OSError: It cannot be written.
    """
    private.make_folder(path.parent)
    path.unlink(missing_ok=True)
    left = MOST_LOG
    with private.open_new(path) as stream:
        for line in redact_lines(lines):
            data = line.encode("utf-8", "replace") + b"\n"
            left -= len(data)
            if left < 0:
                raise LogTooLong(f"its log has more than {MOST_LOG >> 20} MiB")
            stream.write(data)


def log_lines(path: Path) -> Iterator[tuple[str, str]]:
    """Return the engine's time and the text of each line of a log that was written here."""
    with path.open(encoding="utf-8", errors="replace", newline="\n") as stream:
        for line in stream:
            when, _, text = line.rstrip("\n").partition(" ")
            yield when, text


def unpack(path: Path, folder: Path) -> Iterator[Kept]:
    """Write what a tar holds below a folder that is there; yield what became of each entry.

    Raises:
        TarError: It is no tar of plain files, folders and links.
        OSError: Something cannot be written.
    """
    names = _Folder()
    with path.open("rb") as tar:
        archive = TarStream(iter(lambda: tar.read(_PIECE), b""), most_members=_MOST_FILES, any_kind=True)
        for member in archive:
            name = member.name.removeprefix("./").rstrip("/") or "."
            parts = [part for part in name.split("/") if part not in ("", ".")] or ["_"]
            if member.isreg() and len(parts) > _DEEPEST:
                yield Kept(path=name, size=member.size, note=f"it lies deeper than {_DEEPEST} folders")
            elif member.isreg():
                place = names.name(parts)
                digest = _write(archive.content(), folder / place)
                yield Kept(path=name, name=place, size=member.size, sha256=digest, note=_note(name, place))
            elif not member.isdir():
                note = f"a link to {member.linkname[:200]}" if member.issym() else "neither file nor folder nor link"
                yield Kept(path=name, note=note)


def is_safe_name(path: str) -> bool:
    """Return whether a file of this path is kept under just that."""
    return all(_part(part) == part for part in path.strip("/").split("/"))


def _note(path: str, name: str) -> str:
    return "" if path == name else "its name was changed: here it would be another"


class _Folder:
    """The names in a folder that is made here: each is harmless, and no two are the same even where case is not."""

    __slots__ = ("_folders", "_last", "_names", "_used")

    def __init__(self) -> None:
        self._folders: dict[str, _Folder] = {}
        self._names: dict[str, str] = {}
        self._used: set[str] = set()
        self._last: dict[str, int] = {}
        """Name without case -> the last number that was given for it."""

    def name(self, parts: list[str]) -> str:
        """Return where a file is put: each part of its path under a name of its own."""
        folder, names = self, []
        for part in parts:
            names.append(folder._own(part))
            folder = folder._folders.setdefault(part, _Folder())
        return "/".join(names)

    def _own(self, part: str) -> str:
        if part not in self._names:
            name = safe = _part(part)
            number = self._last.get(safe.casefold(), 1)
            while name.casefold() in self._used:
                number += 1
                name = f"{safe}%{number}"
            self._last[safe.casefold()] = number
            self._used.add(name.casefold())
            self._names[part] = name
        return self._names[part]


def _part(part: str) -> str:
    safe = "".join(one if one.isprintable() and one not in _UNSAFE else _escaped(one) for one in part)
    if safe.strip(". ") == "":
        safe = safe.replace(".", "%2E").replace(" ", "%20")
    data = safe.encode()
    if len(data) > _LONGEST_NAME:
        safe = data[: _LONGEST_NAME - 17].decode("utf-8", "ignore") + "%" + hashlib.sha256(data).hexdigest()[:16]
    return safe


def _escaped(one: str) -> str:
    """Return a character's bytes, as they were on the robot, in the form `%XX`."""
    data = one.encode("utf-8", "surrogateescape" if "\udc80" <= one <= "\udcff" else "surrogatepass")
    return "".join(f"%{byte:02X}" for byte in data)


def _write(content: Iterator[bytes], place: Path) -> str:
    """Write a file and the folders above it; return its sha256."""
    place.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    digest = hashlib.sha256()
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW
    with open(os.open(place, flags, 0o600), "wb") as stream:
        for piece in content:
            digest.update(piece)
            stream.write(piece)
        stream.flush()
        os.fsync(stream.fileno())
    return digest.hexdigest()
