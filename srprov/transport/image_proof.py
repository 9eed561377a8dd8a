"""The digests of contents that pass by: of what came, and of what it holds where that is packed by gzip.

Takes pieces of bytes and gives them on as they are. An image names its layers by what they are before they are packed;
archives of engines hold them in either form.
"""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Iterable, Iterator

_PIECE = 1 << 20


class Proof:
    """Which contents have passed by whole."""

    def __init__(self) -> None:
        """Have seen nothing."""
        self.seen: set[str] = set()
        """`sha256:…` of each."""

    def of(self, pieces: Iterable[bytes]) -> Iterator[bytes]:
        """Pass on one content, and know it at its end."""
        outside, inside = hashlib.sha256(), _Unpacked()
        for piece in pieces:
            outside.update(piece)
            inside.update(piece)
            yield piece
        self.seen |= {f"sha256:{outside.hexdigest()}", *inside.digest()}


class _Unpacked:
    """The digest of what a gzip file holds; a mebibyte of it is in memory at a time."""

    def __init__(self) -> None:
        self._made = hashlib.sha256()
        self._reader: zlib._Decompress | None = zlib.decompressobj(wbits=31)

    def update(self, piece: bytes) -> None:
        """Take a piece of the file."""
        while piece and self._reader is not None:
            if self._reader.eof:  # a file may have several members
                self._reader = zlib.decompressobj(wbits=31)
            try:
                self._made.update(self._reader.decompress(piece, _PIECE))
            except zlib.error:
                self._reader = None
                return
            piece = self._reader.unconsumed_tail or self._reader.unused_data

    def digest(self) -> Iterable[str]:
        """Return the digest of all that it held, or nothing."""
        return [f"sha256:{self._made.hexdigest()}"] if self._reader is not None and self._reader.eof else []
