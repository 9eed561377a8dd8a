"""A robot's listing of results, read as it comes: what there is at each place, with sizes and hashes.

Takes bytes; gives entries. Each place has NUL-ended words: for all that is no folder `TYPE SIZE PATH` and where a link
leads, also for what is mounted there and a folder of which not all can be listed, then `H`, then `SHA256  PATH` for
each file, then `=STATUS`.
"""

from __future__ import annotations

import json
import re
from typing import NamedTuple

from srprov.sandbox import named

MOST_FILES = 250_000
MOST_BYTES = 64 << 20
MOST_NAMES = 24 << 20
"""Characters of all paths and links as JSON has them, which is six for each byte that is no text: they are kept in
several forms, and written down."""
MOUNT, UNREAD = "M", "U"
"""Kinds of entries that `find` does not say."""
_MOST_MOUNTS = 256
_LONGEST_WORD = 8192
_LONGEST_LINK = 256
"""Bytes of where a link leads, which is only told."""
_ENTRY = re.compile(rb"(?P<kind>[a-zA-Z?]) (?P<size>[0-9]{1,15}) \./+(?P<path>.+)", re.DOTALL)
_HASH = re.compile(rb"\\?(?P<hash>[0-9a-f]{64}) [ *]\./+(?P<path>.+)", re.DOTALL)
_STATUS = re.compile(rb"=([0-9]{1,3})")


class ListingError(Exception):
    """It is no listing, or too long; the text says why."""


class Entry(NamedTuple):
    """Something that is no folder."""

    path: str
    kind: str
    """As `find` says it: `f` is a file, `l` a link; or `MOUNT`, or `UNREAD`."""
    size: int = 0
    sha256: str = ""
    """Of a file that could be read."""
    link: str = ""
    """Where a link leads."""

    @property
    def is_file(self) -> bool:
        """Tell whether it has content."""
        return self.kind == "f"


class Listing:
    """The listing of some places, in their order."""

    def __init__(self, places: int) -> None:
        """Take how many places there are."""
        self.bytes = 0
        """Bytes of files that were listed so far; the robot hashes them."""
        self._expected = places
        self._done: list[tuple[int, list[Entry]]] = []
        self._entries: dict[str, Entry] = {}
        self._open: Entry | None = None
        self._hashing = False
        self._rest = b""
        self._read_bytes = self._files = self._names = 0

    def feed(self, piece: bytes) -> None:
        """Read what has come.

        Raises:
            ListingError: It is no listing, or too long.
        """
        self._read_bytes += len(piece)
        *words, self._rest = (self._rest + piece).split(b"\0")
        if self._read_bytes > MOST_BYTES or len(self._rest) > _LONGEST_WORD:
            raise ListingError(f"its listing has more than {MOST_BYTES >> 20} MiB, or a path that is too long")
        for word in words:
            self._read(word)

    def all(self) -> list[tuple[int, list[Entry]]]:
        """Return status and entries of each place, by path.

        Raises:
            ListingError: Some place is missing.
        """
        if len(self._done) != self._expected or self._rest or self._entries or self._open:
            raise ListingError("its listing is not whole")
        return self._done

    def _read(self, word: bytes) -> None:
        if len(self._done) == self._expected:
            raise ListingError("its listing goes on behind its end")
        if self._open:
            self._add(self._open._replace(link=_text(word[:_LONGEST_LINK])))
            self._open = None
        elif status := _STATUS.fullmatch(word):
            self._done.append((int(status[1]), _seen(sorted(self._entries.values()))))
            self._entries, self._hashing = {}, False
        elif word == b"H" and not self._hashing:
            self._hashing = True
        elif self._hashing:
            self._hash(word)
        elif match := _ENTRY.fullmatch(word):
            self._open = Entry(_path(match["kind"], match["path"]), match["kind"].decode(), int(match["size"]))
        else:
            raise ListingError(f"its listing has a line that is none: {_text(word)[:80]!r}")

    def _add(self, entry: Entry) -> None:
        self._files += 1
        if self._files > MOST_FILES:
            raise ListingError(f"there are more than {MOST_FILES} files")
        self._names += sum(_written(name) for name in (entry.path, entry.link))
        if self._names > MOST_NAMES:
            raise ListingError(f"the names of its files have more than {MOST_NAMES >> 20} Mi characters")
        self._entries[entry.path] = entry
        self.bytes += entry.size if entry.is_file else 0

    def _hash(self, word: bytes) -> None:
        """Take a hash; of what was not listed before it was made meanwhile, and is for the next listing."""
        match = _HASH.fullmatch(word)
        if match is None:
            raise ListingError(f"its listing has a hash that is none: {_text(word)[:80]!r}")
        path = _text(match["path"])
        if (entry := self._entries.get(path)) and entry.is_file:
            self._entries[path] = entry._replace(sha256=match["hash"].decode())


def _seen(entries: list[Entry]) -> list[Entry]:
    """Leave out what lies below the place of a mount, which hides it from the container."""
    mounts = tuple(f"{one.path}/" for one in entries if one.kind == MOUNT)
    if len(mounts) > _MOST_MOUNTS:
        raise ListingError(f"there are more than {_MOST_MOUNTS} mounts in it")
    return [one for one in entries if not one.path.startswith(mounts)] if mounts else entries


def _path(kind: bytes, said: bytes) -> str:
    """Return the path of an entry; that of a mount is as `/proc/self/mountinfo` has it."""
    if kind == MOUNT.encode():
        said = named(said)
    return _text(said.removesuffix(b"/.") if kind == UNREAD.encode() else said)


def _written(name: str) -> int:
    """Return how long a name is in JSON."""
    return len(name) if name.isascii() and name.isprintable() else len(json.dumps(name))


def _text(word: bytes) -> str:
    return word.decode("utf-8", "surrogateescape")
