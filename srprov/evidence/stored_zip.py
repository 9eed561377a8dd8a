"""Zip archives as srprov writes them, read from files that others may have written.

Takes streams; gives entries. Entries are stored, not compressed, one after the other from the first byte on, without
times and owners: equal contents are equal bytes on every machine, and nothing in an archive can become larger than the
archive is. What is not written so is refused (ValueError), whatever it would unpack to.

Source: PKWARE, ".ZIP File Format Specification" 6.3.10.
"""

from __future__ import annotations

import itertools
import os
import struct
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import BinaryIO

import msgspec

from srprov.definitions.repository_names import WHY, repository_among

PIECE = 1 << 20
MOST_ENTRIES = 200_000
_MOST_DIRECTORY = 64 << 20
_LONGEST_NAME = 1000
"""Bytes."""
_WIDE = 0xFFFFFFFF
"""What stands for a size or an offset that has 64 bits."""
_VERSION, _UTF8 = 45, 0x0800
_TIME, _DATE = 0, (1 << 5) | 1
"""Midnight, 1 January 1980: the first that there is."""
_UNIX = 3 << 8
_MODE = 0o100644 << 16
_LOCAL = struct.Struct("<4s5H3L2H")
_CENTRAL = struct.Struct("<4s6H3L5H2L")
_END = struct.Struct("<4s4H2LH")
_END64 = struct.Struct("<4sQ2H2L4Q")
_LOCATOR = struct.Struct("<4sLQL")
_SIZES = struct.Struct("<2H2Q")
_PLACE = struct.Struct("<2H3Q")


class Entry(msgspec.Struct, frozen=True):
    """One file of an archive."""

    name: str
    size: int
    crc: int
    at: int
    """Where its header begins."""

    @property
    def wide(self) -> bool:
        """Whether its sizes have 64 bits."""
        return self.size >= _WIDE

    @property
    def header(self) -> bytes:
        """What stands before its content."""
        name = self.name.encode()
        extra = _SIZES.pack(1, 16, self.size, self.size) if self.wide else b""
        size = _WIDE if self.wide else self.size
        fields = (_VERSION, _UTF8, 0, _TIME, _DATE, self.crc, size, size, len(name), len(extra))
        return _LOCAL.pack(b"PK\3\4", *fields) + name + extra

    @property
    def record(self) -> bytes:
        """What the directory says of it."""
        name, far = self.name.encode(), self.at >= _WIDE
        extra = _PLACE.pack(1, 24, self.size, self.size, self.at) if self.wide or far else b""
        size, at = (_WIDE, _WIDE) if extra else (self.size, self.at)
        fields = (_UNIX | _VERSION, _VERSION, _UTF8, 0, _TIME, _DATE, self.crc, size, size, len(name), len(extra))
        return _CENTRAL.pack(b"PK\1\2", *fields, 0, 0, 0, _MODE, at) + name + extra


class Names:
    """Names of an archive: each is a plain relative path, and none stands in another's way, even without case."""

    def __init__(self) -> None:
        self._files: dict[str, str] = {}
        """By names without case, and with NUL for a slash: a name has none, and it sorts before all that names have."""

    def add(self, name: str) -> None:
        """Take one more.

        Raises:
            ValueError: No file can have it, or one has it already.
        """
        parts = name.split("/")
        odd = any(part in ("", ".", "..") or part != part.strip(" ") for part in parts)
        if odd or not name.isprintable() or "\\" in name or ":" in name or len(name.encode()) > _LONGEST_NAME:
            raise ValueError(f"an archive cannot have a file of the name {name[:200]!r}")
        key = name.casefold().replace("/", "\0")
        if key in self._files:
            raise _twice(key)
        self._files[key] = name

    def check(self) -> None:
        """Look through all of them, once they are there.

        Raises:
            ValueError: A file stands where another one has a folder; or they would be a repository.
        """
        for above, name in itertools.pairwise(sorted(self._files)):  # what is below a file comes right behind it
            if name.startswith(f"{above}\0"):
                raise _twice(name)
        if made := repository_among(sorted(self._files.values())):
            raise ValueError(f"it has {made[:200]}: {WHY}")


def _twice(key: str) -> ValueError:
    shown = key.replace("\0", "/")[:200]
    return ValueError(f"two files cannot both be there: {shown!r}")


@dataclass(slots=True)
class Writer:
    """An archive that is being written."""

    stream: BinaryIO
    entries: list[Entry] = field(default_factory=list)
    _names: Names = field(default_factory=Names)

    def add(self, name: str, size: int, pieces: Iterable[bytes]) -> None:
        """Add a file.

        Raises:
            ValueError: No file of an archive can have such a name, or it has not this size.
        """
        self._names.add(name)
        at, crc, count = self.stream.seek(0, os.SEEK_END), 0, 0
        self.stream.write(Entry(name, size, 0, at).header)
        for piece in pieces:
            self.stream.write(piece)
            crc, count = zlib.crc32(piece, crc), count + len(piece)
        if count != size:
            raise ValueError(f"{name} changed while it was read")
        one = Entry(name, size, crc, at)
        self.stream.seek(at)
        self.stream.write(one.header)
        self.stream.seek(0, os.SEEK_END)
        self.entries.append(one)

    def finish(self) -> None:
        """Write the directory.

        Raises:
            ValueError: As `Names.check`.
        """
        self._names.check()
        at = self.stream.seek(0, os.SEEK_END)
        directory = b"".join(one.record for one in self.entries)
        self.stream.write(directory + _tail(len(self.entries), len(directory), at))


def _tail(count: int, size: int, at: int) -> bytes:
    """Return what stands behind the directory."""
    wide = b""
    if count >= 0xFFFF or at + size >= _WIDE:
        wide = _END64.pack(b"PK\6\6", _END64.size - 12, _UNIX | _VERSION, _VERSION, 0, 0, count, count, size, at)
        wide += _LOCATOR.pack(b"PK\6\7", 0, at + size, 1)
    number, short_size, short_at = (0xFFFF, _WIDE, _WIDE) if wide else (count, size, at)
    return wide + _END.pack(b"PK\5\6", 0, 0, number, number, short_size, short_at, 0)


def read(stream: BinaryIO) -> list[Entry]:
    """Return the entries of an archive, in its order; no content is read.

    Raises:
        ValueError: It is not such as srprov writes.
        OSError: It cannot be read.
    """
    end = stream.seek(0, os.SEEK_END)
    count, size, at = _directory(stream, end)
    if count > MOST_ENTRIES or size > _MOST_DIRECTORY:
        raise ValueError(f"it has more than {MOST_ENTRIES} files")
    if at + size + len(_tail(count, size, at)) != end:
        raise ValueError("its directory is not where it should be")
    stream.seek(at)
    directory = stream.read(size)
    if stream.read() != _tail(count, size, at):
        raise ValueError("it does not end as it should")
    found = list(_entries(directory, count))
    del directory  # it may have 64 MiB
    names, next_at = Names(), 0
    for one in found:
        names.add(one.name)
        stream.seek(one.at)
        if one.at != next_at or stream.read(len(one.header)) != one.header:
            raise ValueError(f"{one.name[:200]!r} is not where the directory says")
        next_at += len(one.header) + one.size
    names.check()
    if next_at != at:
        raise ValueError("something stands between its files and its directory")
    return found


def _directory(stream: BinaryIO, end: int) -> tuple[int, int, int]:
    """Return how many entries there are, and the size and the place of the directory."""
    stream.seek(max(0, end - _END.size - _LOCATOR.size - _END64.size))
    tail = stream.read()
    if len(tail) < _END.size or not tail.endswith(b"\0\0") or tail[-_END.size :][:4] != b"PK\5\6":
        raise ValueError("it is no zip archive, or one with a comment")
    count, size, at = (_END.unpack(tail[-_END.size :])[one] for one in (4, 5, 6))
    if count != 0xFFFF:
        return count, size, at
    if len(tail) != _END.size + _LOCATOR.size + _END64.size:
        raise ValueError("its directory is broken")
    fields = _END64.unpack(tail[: _END64.size])
    return fields[7], fields[8], fields[9]


def _entries(directory: bytes, count: int) -> Iterator[Entry]:
    at = 0
    for _ in range(count):
        one = _entry(directory, at)
        if directory[at : at + len(one.record)] != one.record:
            raise ValueError(f"{one.name[:200]!r} is compressed, encrypted, a link, or not written as it should be")
        at += len(one.record)
        yield one
    if at != len(directory):
        raise ValueError("its directory has more than its entries")


def _entry(directory: bytes, at: int) -> Entry:
    if len(directory) - at < _CENTRAL.size:
        raise ValueError("its directory ends too early")
    fields = _CENTRAL.unpack_from(directory, at)
    size, place, name_size, extra_size = fields[8], fields[16], fields[10], fields[11]
    start = at + _CENTRAL.size
    raw = directory[start : start + name_size + extra_size] if name_size <= _LONGEST_NAME else b""
    if extra_size == _PLACE.size and len(raw) == name_size + extra_size:
        size, _, place = _PLACE.unpack(raw[name_size:])[2:]
    try:
        return Entry(raw[:name_size].decode(), size, fields[7], place)
    except UnicodeDecodeError:
        raise ValueError("a name is not UTF-8") from None


def content(stream: BinaryIO, one: Entry) -> Iterator[bytes]:
    """Return a file's content in pieces."""
    stream.seek(one.at + len(one.header))
    left = one.size
    while left:
        if not (piece := stream.read(min(left, PIECE))):
            raise ValueError("it ended too early")
        left -= len(piece)
        yield piece
