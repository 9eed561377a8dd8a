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

_PIECE = 1 << 20
_MOST_FILES = 1_000_000
_UNSAFE = frozenset('%\\:*?"<>|')
"""What some file system has no name with; `%` begins what stands for another character."""
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


def write_log(lines: Iterator[str], path: Path) -> None:
    """Write a log, anew if it was begun before; secrets are taken out of it.

    Raises:
        OSError: It cannot be written.
    """
    private.make_folder(path.parent)
    path.unlink(missing_ok=True)
    with private.open_new(path) as stream:
        for line in redact_lines(lines):
            stream.write(line.encode("utf-8", "replace") + b"\n")


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
    taken: dict[str, str] = {}
    with path.open("rb") as tar:
        archive = TarStream(iter(lambda: tar.read(_PIECE), b""), most_members=_MOST_FILES, any_kind=True)
        for member in archive:
            name = member.name.removeprefix("./").rstrip("/") or "."
            if member.isreg():
                place = _name(name, taken)
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


def _name(path: str, taken: dict[str, str]) -> str:
    """Return where a file is put: each part of its path made harmless, and no two the same even where case is not."""
    parts = [_part(part) for part in path.split("/") if part not in ("", ".")]
    name, number = "/".join(parts) or "_", 1
    while taken.setdefault(name.casefold(), path) != path or _blocked(name, taken):
        number += 1
        name = "/".join([*parts[:-1], f"{parts[-1] if parts else '_'}%{number}"])
    return name


def _blocked(name: str, taken: dict[str, str]) -> bool:
    """Return whether a file is where a folder of this path would have to be."""
    parts = name.casefold().split("/")
    return any("/".join(parts[:count]) in taken for count in range(1, len(parts)))


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
