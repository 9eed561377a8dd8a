"""A tar that comes in pieces from a robot -> its members, one header at a time.

Takes pieces of bytes; gives headers and their contents. `tarfile` keeps long names and extended headers of any length
in memory, and follows whatever kinds of member it knows. Here only plain files, links and folders pass, with extended
headers of at most 64 KiB before them, as engines write them with Go's `archive/tar`.

Source: POSIX.1-2008, "pax Interchange Format".
"""

from __future__ import annotations

import re
import tarfile
from collections.abc import Iterator

from srprov.plain_tar import extended_words

_BLOCK = 512
_RECORD = 10_240
_LONGEST_EXTENDED = 64 << 10
_LONGEST_PATH = 4096
_MOST_NAMES = 32 << 20
"""Characters of all names and links together: whoever reads them may keep them."""
_MOST_MEMBERS = 4096
"""An image has at most 127 layers, each a folder and up to three files."""
_MOST_BYTES = 64 << 30
_PIECE = 1 << 20
_KINDS = (tarfile.REGTYPE, tarfile.AREGTYPE, tarfile.SYMTYPE, tarfile.DIRTYPE)


class TarError(Exception):
    """It is no tar that an engine writes; the text says why."""


class TarStream:
    """The members of a tar, in order; what nobody reads of one is skipped."""

    def __init__(self, chunks: Iterator[bytes], *, most_members: int = _MOST_MEMBERS, any_kind: bool = False) -> None:
        """Take the tar as it comes; with `any_kind` also entries that are neither file nor folder nor link."""
        self._most, self._any_kind = most_members, any_kind
        self._chunks, self._rest = chunks, memoryview(b"")
        self._left = self._padding = 0

    def __iter__(self) -> Iterator[tarfile.TarInfo]:
        """Yield each member's header; `content` has what belongs to it.

        Raises:
            TarError: A header is none that an engine writes, or there are too many, or they hold too much.
        """
        count = total = names = 0
        while header := self._header():
            count, total = count + 1, total + header.size
            names += len(header.name) + len(header.linkname)
            if names > _MOST_NAMES:
                raise TarError(f"its names have more than {_MOST_NAMES >> 20} Mi characters")
            if count > self._most or total > _MOST_BYTES:
                raise TarError(f"it has more than {self._most} members, or {_MOST_BYTES >> 30} GiB")
            self._left, self._padding = header.size, -header.size % _BLOCK
            yield header
            for _ in self.content():
                pass
            self._exactly(self._padding)
        self._take(_RECORD)  # what fills the last record, so that the connection can be used again

    def content(self) -> Iterator[bytes]:
        """Yield what is left of the current member, in pieces of at most 1 MiB.

        Raises:
            TarError: The tar ends before.
        """
        while self._left:
            piece = self._exactly(min(self._left, _PIECE))
            self._left -= len(piece)
            yield piece

    def _header(self) -> tarfile.TarInfo | None:
        """Return the next member's header, with what an extended one before it says; None at the end."""
        header, words = self._block(), dict[str, str]()
        if header is not None and header.type == tarfile.XHDTYPE:
            if not 0 <= header.size <= _LONGEST_EXTENDED:
                raise TarError(f"an extended header is longer than {_LONGEST_EXTENDED >> 10} KiB")
            try:
                words = extended_words(self._exactly(header.size))
            except ValueError as error:
                raise TarError("an extended header cannot be read") from error
            self._exactly(-header.size % _BLOCK)
            header = self._block()
            if header is None:
                raise TarError("it ends after an extended header")
        if header is None:
            return None
        header.name, header.linkname = words.get("path", header.name), words.get("linkpath", header.linkname)
        if "size" in words:
            header.size = int(words["size"]) if re.fullmatch("[0-9]{1,18}", words["size"]) else -1
        header.pax_headers = words
        foreign = header.type not in _KINDS and not self._any_kind
        if foreign or header.size < 0 or any(name.startswith("GNU.") for name in words):
            raise TarError(f"{header.name[:80]!r} is no file that an image has")
        if header.size and not header.isreg():
            raise TarError(f"{header.name[:80]!r} is no file, and has content")
        if "\0" in header.name + header.linkname:
            raise TarError("a path holds a NUL, where whoever reads it next would end it")
        if max(len(header.name), len(header.linkname)) > _LONGEST_PATH:
            raise TarError(f"the path {header.name[:80]!r}… is longer than {_LONGEST_PATH} characters")
        return header

    def _block(self) -> tarfile.TarInfo | None:
        """Return the header in the next block, or None if it is empty, as the last ones are."""
        block = self._exactly(_BLOCK)
        if not block.strip(b"\0"):
            return None
        try:
            return tarfile.TarInfo.frombuf(block, "utf-8", "surrogateescape")
        except (tarfile.TarError, ValueError) as error:
            raise TarError(f"a header cannot be read: {error}") from error

    def _exactly(self, size: int) -> bytes:
        data = self._take(size)
        if len(data) < size:
            raise TarError("it ends too early")
        return data

    def _take(self, size: int) -> bytes:
        """Return so many bytes, fewer only at the end."""
        parts: list[memoryview] = []
        while size > 0 and (self._rest or (piece := next(self._chunks, b""))):
            data = self._rest or memoryview(piece)
            parts.append(data[:size])
            self._rest, size = data[size:], size - len(parts[-1])
        return b"".join(parts)


def parts_of(name: str) -> list[str]:
    """Return the folders and the name of a tar's member.

    Raises:
        TarError: It leads up.
    """
    parts = [part for part in name.split("/") if part not in ("", ".")]
    if ".." in parts:
        raise TarError(f"{name[:80]!r} leads out of it")
    return parts


def place_of(name: str, top: list[str], called: str) -> list[str]:
    """Return where a member goes when the tar's top is called otherwise; empty `called`: what is below it has no top.

    Raises:
        TarError: It is not below the top.
    """
    parts = parts_of(name)
    if parts[: len(top)] != top:
        raise TarError(f"{name[:80]!r} is not below {'/'.join(top)!r}")
    return [*filter(None, [called]), *parts[len(top) :]]
