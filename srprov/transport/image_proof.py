"""The digests of contents that pass by: of what came, and of what it holds where that is packed by gzip.

Takes pieces of bytes and gives them on as they are. An image names its layers by what they are before they are packed;
archives of engines hold them in either form.
"""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Iterable, Iterator

from srprov.transport.gzip_reader import BeyondLimits, GzipReader, Measure


class Proof:
    """Which contents have passed by whole."""

    def __init__(self) -> None:
        """Have seen nothing."""
        self.seen: set[str] = set()
        """`sha256:…` of each."""
        self._measure = Measure()
        """Of all that is packed: an archive that is not holds no more either."""

    def of(self, pieces: Iterable[bytes]) -> Iterator[bytes]:
        """Pass on one content, and know it at its end.

        Raises:
            BeyondLimits: What is packed holds more than any image, or next to nothing.
        """
        outside, inside = hashlib.sha256(), _Unpacked(self._measure)
        for piece in pieces:
            outside.update(piece)
            inside.update(piece)
            yield piece
        self.seen |= {f"sha256:{outside.hexdigest()}", *inside.digest()}


class _Unpacked:
    """The digest of what a gzip file holds, which may have several members; a mebibyte of it is in memory at a time."""

    def __init__(self, measure: Measure) -> None:
        self._made = hashlib.sha256()
        self._reader: GzipReader | None = GzipReader(measure, several=True)

    def update(self, piece: bytes) -> None:
        """Take a piece of the file."""
        if self._reader is None:
            return
        try:
            for content in self._reader.unpacked(piece):
                self._made.update(content)
        except BeyondLimits:
            raise
        except zlib.error:
            self._reader = None

    def digest(self) -> Iterable[str]:
        """Return the digest of all that it held, or nothing."""
        return [f"sha256:{self._made.hexdigest()}"] if self._reader is not None and self._reader.ended else []
