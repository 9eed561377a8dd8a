"""One file of the cache of layers: a gzip file, compared with the digest of its content.

Takes pieces of bytes; gives a `Blob`, or raises. `blobs.py` keeps them.
"""

from __future__ import annotations

import errno
import hashlib
import os
import stat
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import BinaryIO

import msgspec

from srprov.transport.gzip_reader import BeyondLimits, GzipReader

_PIECE = 1 << 20


class WrongBlob(Exception):
    """What came is not what the digest says; the text says how."""


class Blob(msgspec.Struct, frozen=True):
    """A content that was compared with its digest."""

    digest: str
    """`sha256:…` of the content."""
    path: Path
    """Where it is, compressed."""
    size: int
    """Bytes of the file."""
    content_size: int
    """Bytes of the content."""
    compressed: str
    """`sha256:…` of the file: the digest by which a registry names it."""

    def open(self) -> BinaryIO:
        """Open the file to read; OSError when it is gone."""
        return open_regular(self.path)

    def pieces(self) -> Iterator[bytes]:
        """Yield the file's bytes, in pieces of at most 1 MiB.

        Raises:
            OSError: It is gone, or cannot be read.
        """
        with self.open() as file:
            while piece := file.read(_PIECE):
                yield piece

    def content(self) -> Iterator[bytes]:
        """Yield the content's bytes, in pieces of at most 1 MiB; raises as `pieces` does."""
        try:
            yield from inflated(self.pieces())
        except zlib.error as error:
            raise OSError(errno.EIO, "it was changed meanwhile", os.fspath(self.path)) from error


class Hash:
    """The sha256 of bytes that go by, and how many there are."""

    def __init__(self) -> None:
        """Begin with none."""
        self._sum, self.size = hashlib.sha256(), 0

    def update(self, piece: bytes) -> bytes:
        """Add a piece, and return it."""
        self._sum.update(piece)
        self.size += len(piece)
        return piece

    @property
    def digest(self) -> str:
        """`sha256:…`."""
        return f"sha256:{self._sum.hexdigest()}"


def open_regular(path: Path) -> BinaryIO:
    """Open a regular file to read; raises OSError for anything else."""
    file = open(os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC), "rb")  # noqa: SIM115 - the caller's
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        file.close()
        raise OSError(errno.EINVAL, "it is no file", os.fspath(path))
    return file


def identity_of(descriptor: int) -> tuple[int, ...]:
    """Return what changes when an open file is written to, or is another one."""
    about = os.fstat(descriptor)
    return about.st_dev, about.st_ino, about.st_size, about.st_mtime_ns


def written(file: BinaryIO, pieces: Iterable[bytes]) -> Iterator[bytes]:
    """Pass pieces on once they are written."""
    for piece in pieces:
        file.write(piece)
        yield piece


def compared(digest: str, path: Path, pieces: Iterable[bytes]) -> Blob:
    """Read a compressed content to its end.

    Raises:
        WrongBlob: It is not one gzip file, or not of that content.
    """
    inside, outside, reader = Hash(), Hash(), GzipReader()
    try:
        for arrived in pieces:
            for content in reader.unpacked(outside.update(arrived)):
                inside.update(content)
    except BeyondLimits as error:
        raise WrongBlob(f"{digest}: {error}") from error
    except zlib.error as error:
        raise WrongBlob(f"{digest}: it is not compressed by gzip ({error})") from error
    if not reader.ended or reader.followed or inside.digest != digest:
        raise WrongBlob(f"{digest}: what came is {inside.digest if reader.ended else 'cut off'}")
    return Blob(digest, path, outside.size, inside.size, outside.digest)


def inflated(pieces: Iterable[bytes]) -> Iterator[bytes]:
    """Yield what gzip's pieces become, in pieces of at most 1 MiB.

    Raises:
        zlib.error: They are not one gzip file, or hold too much, or next to nothing.
    """
    reader = GzipReader()
    for piece in pieces:
        yield from reader.unpacked(piece)
