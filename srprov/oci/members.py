"""A layer's tar that comes in pieces -> its members, whatever tool wrote it.

Takes pieces of bytes; gives a header at a time, and contents. Layers are written by many tools: long names come as GNU
tar or as POSIX has them, and there are links and devices. Headers of any length are not kept; what cannot be read is a
ValueError.

Source: POSIX.1-2008, "pax Interchange Format"; GNU tar, "Basic Tar Format".
"""

from __future__ import annotations

import re
import tarfile
from collections.abc import Iterable, Iterator

import msgspec

_BLOCK = 512
_LONGEST_HEADER = 1 << 20
_MOST_MEMBERS = 5_000_000
_MOST_HEADERS = 64
"""Extended ones before a member."""
_PIECE = 1 << 20
_LONG_NAME, _LONG_LINK, _SPARSE = b"L", b"K", b"S"
_RECORD = re.compile(rb"([0-9]{1,7}) ")


class Entry(msgspec.Struct, frozen=True):
    """One member."""

    path: str
    """As a relative path, without `./` and without a slash at its end."""
    size: int
    is_file: bool
    is_folder: bool


class Members:
    """The members of a layer, in order; what nobody reads of one is skipped."""

    def __init__(self, pieces: Iterable[bytes]) -> None:
        """Take the tar as it comes."""
        self._pieces, self._rest = iter(pieces), memoryview(b"")
        self._left = 0

    def __iter__(self) -> Iterator[Entry]:
        """Yield each member; to the end of the pieces, so that whoever counts them sees all.

        Raises:
            ValueError: It is no tar, or has too many members, or ends too early.
        """
        for _ in range(_MOST_MEMBERS):
            found = self._next()
            if found is None:
                while self._take(_PIECE):
                    pass
                return
            self._left = found.size
            yield found
            self._skip(self._left + -found.size % _BLOCK)
            self._left = 0
        raise ValueError(f"a layer has more than {_MOST_MEMBERS} members")

    def content(self) -> Iterator[bytes]:
        """Yield what is left of the present member."""
        while self._left:
            piece = self._exactly(min(self._left, _PIECE))
            self._left -= len(piece)
            yield piece

    def _next(self) -> Entry | None:
        """Return the next member with what extended headers say of it; None at the end."""
        path, size = "", -1
        for _ in range(_MOST_HEADERS):
            header = self._header()
            if header is None:
                return None
            if header.type == _SPARSE:
                raise ValueError("a file in it is stored sparse")
            if header.type == tarfile.XHDTYPE:
                path, size = _extended(self._document(header.size), path, size)
            elif header.type == _LONG_NAME:
                path = self._document(header.size).partition(b"\0")[0].decode("utf-8", "surrogateescape")
            elif header.type in (_LONG_LINK, tarfile.XGLTYPE):
                self._document(header.size)
            else:
                return _entry(header, path, size)
        raise ValueError("a member of it has too many headers")

    def _header(self) -> tarfile.TarInfo | None:
        block = self._take(_BLOCK)
        if not block.strip(b"\0"):
            return None
        if len(block) < _BLOCK:
            raise ValueError("it ends too early")
        try:
            return tarfile.TarInfo.frombuf(block, "utf-8", "surrogateescape")
        except (tarfile.TarError, ValueError):
            raise ValueError("it is no tar") from None

    def _document(self, size: int) -> bytes:
        if not 0 <= size <= _LONGEST_HEADER:
            raise ValueError("a header in it is longer than any sensible one")
        data = self._exactly(size)
        self._skip(-size % _BLOCK)
        return data

    def _skip(self, size: int) -> None:
        while size:
            size -= len(self._exactly(min(size, _PIECE)))

    def _exactly(self, size: int) -> bytes:
        data = self._take(size)
        if len(data) < size:
            raise ValueError("it ends too early")
        return data

    def _take(self, size: int) -> bytes:
        """Return so many bytes, fewer only at the end."""
        parts: list[memoryview] = []
        while size > 0 and (self._rest or (piece := next(self._pieces, b""))):
            data = self._rest or memoryview(piece)
            parts.append(data[:size])
            self._rest, size = data[size:], size - len(parts[-1])
        return b"".join(parts)


def _entry(header: tarfile.TarInfo, path: str, size: int) -> Entry:
    is_file = header.type in (tarfile.REGTYPE, tarfile.AREGTYPE, tarfile.CONTTYPE)
    if size < 0 or not is_file:
        size = header.size if is_file else 0
    if size < 0:
        raise ValueError("a member of it has no size")
    parts = [one for one in (path or header.name).split("/") if one not in ("", ".")]
    return Entry("/".join(parts), size, is_file, header.type == tarfile.DIRTYPE)


def _extended(data: bytes, path: str, size: int) -> tuple[str, int]:
    """Return path and size as an extended header has them, where it does."""
    at = 0
    while at < len(data):
        match = _RECORD.match(data, at)
        length = int(match[1]) if match else 0
        if match is None or length <= len(match[0]) or at + length > len(data):
            raise ValueError("an extended header in it cannot be read")
        key, _, value = data[match.end() : at + length - 1].partition(b"=")
        if key == b"path":
            path = value.decode("utf-8", "surrogateescape")
        elif key == b"size":
            if not re.fullmatch(rb"[0-9]{1,18}", value):
                raise ValueError("a member of it has no size")
            size = int(value)
        elif key.startswith(b"GNU.sparse"):
            raise ValueError("a file in it is stored sparse")
        at += length
    return path, size
