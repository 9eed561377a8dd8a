"""The cache of layers and configurations of images on this machine, by the hash of their content.

Takes and gives gzip files: `FOLDER/<64 hex digits>.gz`, where the digits are the sha256 of the content *before*
compression: a layer's diff id, or a configuration's image id. What a file holds is compared with its name before it is
used for the first time in a process; one that does not fit is removed. The least recently used go when the cache is
full. Folder and files are their owner's alone. Safe for several threads, and for several processes.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import re
import secrets
import stat
import threading
import time
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from srprov import private

MOST_BYTES = 8 << 30
_MOST_CONTENT = 64 << 30
"""Bytes of one content: what a few bytes can become when they are decompressed has no other limit."""
_PIECE = 1 << 20
_DIGEST = re.compile("sha256:([0-9a-f]{64})")
_ABANDONED_S = 86_400.0
"""Seconds after which an unfinished file is nobody's any more."""


class WrongBlob(Exception):
    """What came is not what the digest says; the text says how."""


@dataclass(frozen=True, slots=True)
class Blob:
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
        return _open(self.path)

    def pieces(self) -> Iterator[bytes]:
        """Yield the file's bytes, in pieces of at most 1 MiB.

        Raises:
            OSError: It is gone, or cannot be read.
        """
        with self.open() as file:
            while piece := file.read(_PIECE):
                yield piece


class Blobs:
    """The cache; nothing is touched before it is used."""

    def __init__(self, folder: Path | None = None, most_bytes: int = MOST_BYTES) -> None:
        """Take where it is (default: `$XDG_CACHE_HOME/srprov/blobs`) and how large it may become."""
        self._folder, self._most = folder or default_folder(), most_bytes
        self._lock = threading.Lock()
        self._turns: dict[str, threading.Lock] = {}
        self._known: dict[str, tuple[tuple[int, ...], Blob]] = {}
        """Digest -> the file's identity when it was compared, and what it was."""

    def size(self, digest: str) -> int | None:
        """Return the bytes of a file that is there, unchecked; None where there is none."""
        try:
            return self._path(digest).stat().st_size
        except (OSError, ValueError):
            return None

    def get(self, digest: str) -> Blob | None:
        """Return a content that is there and is what its digest says; None where there is none."""
        path = self._path(digest)
        try:
            with _open(path) as file:
                identity = _identity(file.fileno())
                known = self._known.get(digest)
                if known is None or known[0] != identity:
                    pieces = iter(lambda: file.read(_PIECE), b"")
                    known = identity, _compared(digest, path, pieces)
            # only the access time: the other is part of what tells that the file is the one that was compared
            os.utime(path, ns=(time.time_ns(), path.stat().st_mtime_ns))
        except WrongBlob:
            path.unlink(missing_ok=True)
            return None
        except OSError:
            return None
        self._known[digest] = known
        return known[1]

    def add(self, digest: str, pieces: Iterable[bytes]) -> Blob:
        """Keep a content that comes compressed by gzip, and make room for it.

        Raises:
            WrongBlob: It is not what the digest says; nothing is kept.
            OSError: It cannot be written.
        """
        path = self._path(digest)
        private.make_folder(self._folder)
        partial = path.with_name(f"{secrets.token_hex(8)}.part")
        try:
            with open(os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
                blob = _compared(digest, path, _written(file, pieces))
            os.replace(partial, path)
        finally:
            partial.unlink(missing_ok=True)
        with _open(path) as file:
            self._known[digest] = _identity(file.fileno()), blob
        self._make_room()
        return blob

    def add_content(self, digest: str, content: bytes) -> Blob:
        """Keep a content that comes as it is; raises as `add` does."""
        packer = zlib.compressobj(1, wbits=31)
        return self.add(digest, [packer.compress(content) + packer.flush()])

    @contextlib.contextmanager
    def turn(self, digest: str) -> Iterator[None]:
        """Wait until nobody else in this process gets this content; then it is there, or the caller gets it."""
        with self._lock:
            turn = self._turns.setdefault(digest, threading.Lock())
        with turn:
            yield

    def _path(self, digest: str) -> Path:
        match = _DIGEST.fullmatch(digest)
        if match is None:
            raise ValueError(f"{digest[:80]!r} is no sha256 digest")
        return self._folder / f"{match[1]}.gz"

    def _make_room(self) -> None:
        """Remove the least recently used, but none that this process has used: it may be about to be sent."""
        with self._lock:
            found, total = list[tuple[int, int, Path]](), 0
            for path in self._folder.iterdir():
                with contextlib.suppress(OSError):  # another process may have removed it
                    about = path.stat()
                    if path.suffix == ".part" and time.time() - about.st_mtime > _ABANDONED_S:
                        path.unlink()
                    elif path.suffix == ".gz":
                        total += about.st_size
                        found.append((about.st_atime_ns, about.st_size, path))
            used = {blob.path for _, blob in list(self._known.values())}
            for _, size, path in sorted(found):
                if total <= self._most:
                    return
                if path not in used:
                    path.unlink(missing_ok=True)
                    total -= size


def default_folder() -> Path:
    """Return where the user's cache is."""
    cache_home = os.environ.get("XDG_CACHE_HOME", "")
    base = Path(cache_home) if cache_home.startswith("/") else Path(os.environ.get("HOME", "/nonexistent")) / ".cache"
    return base / "srprov" / "blobs"


def _open(path: Path) -> BinaryIO:
    """Open a regular file to read; raises OSError for anything else."""
    file = open(os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC), "rb")  # noqa: SIM115 - the caller's
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        file.close()
        raise OSError(errno.EINVAL, "it is no file", os.fspath(path))
    return file


def _identity(descriptor: int) -> tuple[int, ...]:
    about = os.fstat(descriptor)
    return about.st_dev, about.st_ino, about.st_size, about.st_mtime_ns


def _written(file: BinaryIO, pieces: Iterable[bytes]) -> Iterator[bytes]:
    """Pass pieces on once they are written."""
    for piece in pieces:
        file.write(piece)
        yield piece


def _compared(digest: str, path: Path, pieces: Iterable[bytes]) -> Blob:
    """Read a compressed content to its end.

    Raises:
        WrongBlob: It is not one gzip file, or not of that content.
    """
    inside, outside = hashlib.sha256(), hashlib.sha256()
    size = content_size = 0
    unpacker = zlib.decompressobj(wbits=31)
    try:
        for arrived in pieces:
            piece = arrived
            outside.update(piece)
            size += len(piece)
            if unpacker.eof:
                raise WrongBlob(f"{digest}: something follows the compressed content")
            while content := unpacker.decompress(piece, _PIECE):
                inside.update(content)
                content_size += len(content)
                piece = unpacker.unconsumed_tail
                if content_size > _MOST_CONTENT:
                    raise WrongBlob(f"{digest}: it holds more than {_MOST_CONTENT >> 30} GiB")
    except zlib.error as error:
        raise WrongBlob(f"{digest}: it is not compressed by gzip ({error})") from error
    found = f"sha256:{inside.hexdigest()}"
    if not unpacker.eof or unpacker.unused_data or found != digest:
        raise WrongBlob(f"{digest}: what came is {found if unpacker.eof else 'cut off'}")
    return Blob(digest, path, size, content_size, f"sha256:{outside.hexdigest()}")
