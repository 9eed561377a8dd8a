"""Tars as srprov writes them, read from bytes that others may have written.

Takes bytes; gives members, or raises ValueError for all that `tarfile` does not write, in pax format, for plain files,
folders and symbolic links without owners and times. `tarfile` would go wherever a header sends it, also back.

Source: POSIX.1-2008, "pax Interchange Format".
"""

from __future__ import annotations

import functools
import re
import tarfile
from collections.abc import Iterable, Iterator

import msgspec

_BLOCK = 512
_RECORD = 10_240
_MOST_MEMBERS = 100_000
_LONGEST_EXTENDED = 16_384
"""Bytes of the path and the link of one member, where they do not fit into its header."""
_NAME, _MODE, _SIZE, _SUM, _KIND, _LINK = (slice(0, 100), slice(100, 108), slice(124, 136), slice(148, 156),
                                          slice(156, 157), slice(157, 257))  # fmt: skip

_RECORD_START = re.compile(rb"([0-9]{1,5}) ([^=\n]{1,255})=")


class Member(msgspec.Struct, frozen=True):
    """One entry of a tar."""

    path: str
    """Without a slash at the end."""
    mode: int
    content: bytes | None = None
    """Of a file."""
    link: str | None = None
    """Where a symbolic link points to."""

    @property
    def is_folder(self) -> bool:
        """Whether it is neither a file nor a link."""
        return self.content is None and self.link is None


def members(tar: bytes) -> Iterator[Member]:
    """Return the members of a tar, in their order.

    Raises:
        ValueError: It is not such as srprov writes, or has too many.
    """
    at = count = 0
    while tar[at : at + _BLOCK].strip(b"\0"):
        count += 1
        one, end = _member(tar, at)
        if count > _MOST_MEMBERS:
            raise ValueError(f"a tar of more than {_MOST_MEMBERS} members")
        yield one
        at = end
    whole = -(-(at + 2 * _BLOCK) // _RECORD) * _RECORD
    if len(tar) != whole or tar.count(0, at) != whole - at:
        raise ValueError("a tar that does not end as it should")


def check_paths(found: Iterable[Member]) -> None:
    """Refuse members that could lie elsewhere than they say, or stand twice.

    Raises:
        ValueError: A path is not plain, or what lies above it is no folder that stands before it.
    """
    folders, seen = {""}, set()
    for one in found:
        above, _, name = one.path.rpartition("/")
        if one.path in seen or above not in folders or name in ("", ".", "..") or one.path.startswith("/"):
            raise ValueError(f"a tar in which {one.path[:100]!r} cannot stand")
        seen.add(one.path)
        if one.is_folder:
            folders.add(one.path)


def extended_words(records: bytes) -> dict[str, str]:
    """Return the words of an extended header, of any tar; of a key that stands twice the last.

    Raises:
        ValueError: It is not written as POSIX has it.
    """
    words, at = dict[str, str](), 0
    while at < len(records):
        match = _RECORD_START.match(records, at)
        end = at + int(match[1]) if match else 0
        if match is None or not match.end() < end <= len(records) or records[end - 1 : end] != b"\n":
            raise ValueError("an extended header of a tar cannot be read")
        words[match[2].decode("utf-8", "replace")] = records[match.end() : end - 1].decode("utf-8", "surrogateescape")
        at = end
    return words


def _member(tar: bytes, start: int) -> tuple[Member, int]:
    """Return the member whose header begins at `start`, and where the next one does."""
    at, words = start, {}
    if tar[at + 156 : at + 157] == tarfile.XHDTYPE:
        size = _octal(tar[at : at + _BLOCK][_SIZE])
        if size > _LONGEST_EXTENDED:
            raise ValueError("a name that is too long")
        words = extended_words(tar[at + _BLOCK : at + _BLOCK + size])
        at += _BLOCK + _padded(size)
    header = tar[at : at + _BLOCK]
    at += _BLOCK
    kind, size = header[_KIND], _octal(header[_SIZE])
    path = words.get("path") or _text(header[_NAME])
    content, link = None, None
    if kind == tarfile.REGTYPE:
        content = tar[at : at + size]
    elif kind == tarfile.SYMTYPE:
        link = words.get("linkpath") or _text(header[_LINK])
    one = Member(path.removesuffix("/") if kind == tarfile.DIRTYPE else path, _octal(header[_MODE]), content, link)
    if "\0" in one.path or "\0" in (link or ""):
        # GNU tar ends it there: what is checked under one name would be unpacked under another, a link as a tree itself
        raise ValueError("a tar with a name that no file can have")
    end = at + _padded(len(content or b""))
    # whatever else could stand in it is not what is written here
    if tar[start:at] != _header(one) or tar.count(0, at + size, end) != end - at - size:
        raise ValueError(f"a tar in which {one.path[:100]!r} is not written as it should")
    return one, end


def _header(one: Member) -> bytes:
    """Return what `tarfile` writes before a member's content."""
    kind = tarfile.DIRTYPE if one.is_folder else tarfile.REGTYPE if one.link is None else tarfile.SYMTYPE
    path, link = one.path + ("/" if one.is_folder else ""), one.link or ""
    if not (path.isascii() and link.isascii() and len(path) <= 100 and len(link) <= 100):
        entry = tarfile.TarInfo(one.path)
        entry.type, entry.mode, entry.linkname, entry.size = kind, one.mode, link, len(one.content or b"")
        return entry.tobuf(tarfile.PAX_FORMAT)
    block = bytearray(_empty())
    block[_NAME], block[_LINK] = path.encode().ljust(100, b"\0"), link.encode().ljust(100, b"\0")
    block[_MODE], block[_SIZE], block[_KIND] = (
        b"%07o\0" % (one.mode & 0o7777),
        b"%011o\0" % len(one.content or b""),
        kind,
    )
    block[_SUM] = b" " * 8
    block[_SUM] = b"%06o\0 " % sum(block)
    return bytes(block)


@functools.cache
def _empty() -> bytes:
    return tarfile.TarInfo("").tobuf(tarfile.PAX_FORMAT)


def _octal(field: bytes) -> int:
    if not re.fullmatch(rb"[0-7]{7}(?:[0-7]{4})?\0", field):
        raise ValueError("a number of a tar that is none")
    return int(field[:-1], 8)


def _text(field: bytes) -> str:
    return field.partition(b"\0")[0].decode("ascii")


def _padded(size: int) -> int:
    return -(-size // _BLOCK) * _BLOCK
