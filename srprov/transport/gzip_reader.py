"""What gzip's bytes become, within limits: a few may become any amount, and any number of them nothing at all.

Takes and gives pieces of bytes. Pure.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator

_PIECE = 1 << 20
_SLICE = 16 << 10
"""Bytes of a file of several members that zlib gets at once: for each member it copies all that follows."""
_MOST_CONTENT = 64 << 30
"""Bytes of content: what a few bytes can become when they are unpacked has no other limit."""
_EMPTY = 1 << 20
"""Bytes of gzip beyond what they become: its blocks and members may have nothing in them, and then have no end."""


class BeyondLimits(zlib.error):
    """No content is like that; the text says how it is."""


class Measure:
    """How much came, and what it became: of one gzip file, or of all in an archive."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self.came = self.given = 0

    def add_given(self, size: int) -> None:
        """Count what some bytes became; raises BeyondLimits."""
        self.given += size
        if self.given > _MOST_CONTENT:
            raise BeyondLimits(f"it holds more than {_MOST_CONTENT >> 30} GiB")

    def add_came(self, size: int) -> None:
        """Count bytes of which all has been counted that they became; raises BeyondLimits."""
        self.came += size
        if self.came > self.given + self.given // 8 + _EMPTY:
            raise BeyondLimits("it holds next to nothing")


class GzipReader:
    """Reads one gzip file."""

    def __init__(self, measure: Measure | None = None, *, several: bool = False) -> None:
        """Take what counts, if that is not this file alone; and whether the file may have several members."""
        self._measure, self._several = measure or Measure(), several
        self._unpacker = zlib.decompressobj(wbits=31)

    @property
    def ended(self) -> bool:
        """Whether a member ended with what has come, and nothing of a next one came."""
        return self._unpacker.eof

    @property
    def followed(self) -> bool:
        """Whether something came in the last piece behind the end of a file of one member."""
        return bool(self._unpacker.unused_data)

    def unpacked(self, piece: bytes) -> Iterator[bytes]:
        """Yield what a piece of the file becomes, however much that is, in pieces of at most 1 MiB.

        Raises:
            BeyondLimits: It becomes too much, or next to nothing.
            zlib.error: It is none of a gzip file.
        """
        if self._unpacker.eof and not self._several:  # zlib would keep all that follows
            raise zlib.error("something follows the compressed content")
        step = _SLICE if self._several else len(piece) or 1
        for at in range(0, len(piece), step):
            part = rest = piece[at : at + step]
            while rest:
                if self._unpacker.eof:
                    self._unpacker = zlib.decompressobj(wbits=31)
                while content := self._unpacker.decompress(rest, _PIECE):
                    self._measure.add_given(len(content))
                    yield content
                    rest = self._unpacker.unconsumed_tail
                rest = self._unpacker.unused_data if self._several else b""
            self._measure.add_came(len(part))
