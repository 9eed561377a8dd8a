"""A layer's tar packed by gzip, and unpacked again within limits.

Takes pieces of bytes; gives pieces. One piece is in memory at a time. Equal layers give equal bytes: no time and no
name is written. Another version of zlib may pack the same layer otherwise; what it becomes is the same.

Source: RFC 1952; OCI Image Format Specification, "Layer Filesystem Changeset".
"""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Iterable, Iterator

_LEVEL = 6
_GZIP = 31
_PIECE = 1 << 20
_ANY = 1 << 30
_MOST_RATIO = 100


def most_content(packed: int) -> int:
    """Return how many bytes a layer of so many packed ones may have: what is more is a bomb, and no layer."""
    return _ANY + _MOST_RATIO * packed


class Packer:
    """Packs a layer piece by piece, and counts both sides."""

    def __init__(self) -> None:
        """Begin."""
        self._packer = zlib.compressobj(_LEVEL, wbits=_GZIP)
        self._inside, self._outside = hashlib.sha256(), hashlib.sha256()
        self.content_size = self.size = 0
        """Bytes of the layer, and of what it was packed into."""

    def add(self, piece: bytes) -> bytes:
        """Take a piece of the layer; give what is ready."""
        self._inside.update(piece)
        self.content_size += len(piece)
        return self._out(self._packer.compress(piece))

    def finish(self) -> bytes:
        """Give the rest."""
        return self._out(self._packer.flush())

    def _out(self, piece: bytes) -> bytes:
        self._outside.update(piece)
        self.size += len(piece)
        return piece

    @property
    def content_digest(self) -> str:
        """`sha256:…` of the layer."""
        return f"sha256:{self._inside.hexdigest()}"

    @property
    def digest(self) -> str:
        """`sha256:…` of what it was packed into."""
        return f"sha256:{self._outside.hexdigest()}"


def unpacked(pieces: Iterable[bytes], most: int) -> Iterator[bytes]:
    """Unpack a layer, in pieces of at most 1 MiB.

    Args:
        pieces: One gzip file.
        most: Bytes that it may become.

    Raises:
        ValueError: It is none, or not whole, or something follows it, or it becomes more.
    """
    unpacker, count = zlib.decompressobj(wbits=_GZIP), 0
    try:
        for arrived in pieces:
            piece = arrived
            if unpacker.eof:
                raise ValueError("something follows the layer")
            while content := unpacker.decompress(piece, _PIECE):
                count += len(content)
                if count > most:
                    raise ValueError(f"it becomes more than {most >> 20} MiB")
                yield content
                piece = unpacker.unconsumed_tail
    except zlib.error:
        raise ValueError("it is not packed by gzip") from None
    if not unpacker.eof or unpacker.unused_data:
        raise ValueError("it is cut off, or something follows it")
