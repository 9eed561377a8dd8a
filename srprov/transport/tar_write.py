"""Members of a tar that is written here, piece by piece: plain files with short names.

Source: POSIX.1-2008, "ustar".
"""

from __future__ import annotations

import tarfile
from collections.abc import Iterator

from srprov.transport.blob import Blob

END = b"\0" * 1024


def tar_file(name: str, content: bytes) -> Iterator[bytes]:
    """Yield a file."""
    yield _header(name, len(content))
    yield content + b"\0" * (-len(content) % 512)


def tar_blob(name: str, blob: Blob) -> Iterator[bytes]:
    """Yield a blob as it is compressed.

    Raises:
        OSError: The cache's file is gone.
    """
    yield _header(name, blob.size)
    yield from blob.pieces()
    yield b"\0" * (-blob.size % 512)


def _header(name: str, size: int) -> bytes:
    header = tarfile.TarInfo(name)
    header.size = size
    return header.tobuf(tarfile.GNU_FORMAT)  # one block, whatever the size
