"""The cache of layers and configurations of images on this machine, by the hash of their content.

Takes and gives gzip files: `FOLDER/<64 hex digits>.gz`, where the digits are the sha256 of the content *before*
compression: a layer's diff id, or a configuration's image id; `<digits>.raw.gz` is not compressed, only in gzip's
frame, for fast links. What a file holds is compared with its name before it is
used for the first time in a process; one that does not fit is removed. The least recently used go when the cache is
full. Folder and files are their owner's alone. Safe for several threads, and for several processes.
"""

from __future__ import annotations

import contextlib
import errno
import os
import re
import secrets
import shutil
import threading
import time
import zlib
from collections.abc import Callable, Collection, Iterable, Iterator
from pathlib import Path
from typing import BinaryIO

from srprov import believed, private
from srprov.transport.blob import Blob, Hash, WrongBlob, compared, identity_of, open_regular, written
from srprov.transport.givers import Givers
from srprov.transport.turns import OwnTurns, Turns

__all__ = ["Blob", "Blobs", "WrongBlob"]

MOST_BYTES = 8 << 30
_LEFT_FREE = 512 << 20
"""Bytes of the disk that no content takes while it comes."""
_LOOK = 32 << 20
"""Bytes between two looks at the disk."""
_PIECE = 1 << 20
_DIGEST = re.compile("sha256:([0-9a-f]{64})")
_ABANDONED_S = 86_400.0
"""Seconds after which an unfinished file is nobody's any more."""


class Blobs:
    """The cache; nothing is touched before it is used."""

    def __init__(self, folder: Path | None = None, most_bytes: int = MOST_BYTES, turns: Turns | None = None) -> None:
        """Take where it is (default: `$XDG_CACHE_HOME/srprov/blobs`), how large it may become, and who gives turns."""
        self.folder, self._most = folder or default_folder(), most_bytes
        self._lock = threading.Lock()
        self._turns = turns or OwnTurns()
        self.givers = Givers(self.folder)
        self._known: dict[Path, tuple[tuple[int, ...], Blob]] = {}
        """File -> its identity when it was compared, and what it was."""

    def size(self, digest: str) -> int | None:
        """Return the bytes of a compressed file that is there, unchecked; None where there is none."""
        try:
            return self._path(digest).stat().st_size
        except (OSError, ValueError):
            return None

    def total(self) -> int:
        """Return the bytes of all that is kept."""
        return sum(size for _, size, _ in self._kept())

    def clear(self) -> int:
        """Remove all that is kept, and return how many bytes that were.

        Raises:
            OSError: A file cannot be removed.
        """
        removed = 0
        for _, size, path in self._kept():
            path.unlink(missing_ok=True)
            removed += size
        return removed

    def get(self, digest: str, raw: Callable[[], bool] = lambda: False) -> Blob | None:
        """Return a content that is there and is what its digest says; None where there is none.

        Args:
            digest: Its own.
            raw: Asked when only one is there that is not compressed: it need not be.

        Raises:
            OSError: One that is not compressed and has to be cannot be written.
        """
        if not self._is_ours():
            return None
        if (blob := self._checked(digest, self._path(digest))) is not None:
            return blob
        blob = self._checked(digest, self._path(digest, raw=True))
        return blob if blob is None or raw() else self.add_wanted({digest}, blob.content())

    def _is_ours(self) -> bool:
        """Return whether no link of others leads to it: what is removed there could be the user's own files."""
        with contextlib.suppress(OSError):
            return believed.is_out_of_reach(self.folder)
        return False  # nothing is there, too

    def _checked(self, digest: str, path: Path) -> Blob | None:
        """Return a file if it is what it is called; remove it if not."""
        try:
            with open_regular(path) as file:
                identity = identity_of(file.fileno())
                known = self._known.get(path)
                if known is None or known[0] != identity:
                    pieces = iter(lambda: file.read(_PIECE), b"")
                    known = identity, compared(digest, path, pieces)
            # only the access time: the other is part of what tells that the file is the one that was compared
            os.utime(path, ns=(time.time_ns(), path.stat().st_mtime_ns))
        except WrongBlob:
            path.unlink(missing_ok=True)
            return None
        except OSError:
            return None
        self._known[path] = known
        return known[1]

    def add(self, digest: str, pieces: Iterable[bytes]) -> Blob:
        """Keep a content that comes compressed by gzip, and make room for it.

        Raises:
            WrongBlob: It is not what the digest says; nothing is kept.
            OSError: It cannot be written.
        """
        with self._partial() as (partial, file):
            blob = compared(digest, self._path(digest), written(file, self._with_room(pieces)))
            file.flush()
            return self._keep(partial, blob)

    def add_content(self, digest: str, pieces: Iterable[bytes], *, raw: bool = False) -> Blob:
        """Keep a content that comes as it is, compressed or not; raises as `add` does."""
        blob = self.add_wanted({digest}, pieces, raw=raw)
        if blob is None:
            raise WrongBlob(f"{digest}: what came is another content")
        return blob

    def add_wanted(self, digests: Collection[str], pieces: Iterable[bytes], *, raw: bool = False) -> Blob | None:
        """Keep a content that comes as it is, if it is one of these; None if it is another.

        Raises:
            OSError: It cannot be written.
        """
        inside, outside, packer = Hash(), Hash(), zlib.compressobj(0 if raw else 1, wbits=31)
        with self._partial() as (partial, file):
            for piece in self._with_room(pieces):
                inside.update(piece)
                file.write(outside.update(packer.compress(piece)))
            file.write(outside.update(packer.flush()))
            file.flush()
            if inside.digest not in digests:
                return None
            path = self._path(inside.digest, raw=raw)
            return self._keep(partial, Blob(inside.digest, path, outside.size, inside.size, outside.digest))

    def _with_room(self, pieces: Iterable[bytes]) -> Iterator[bytes]:
        """Pass on a content of a robot's, which says no size before, as long as it leaves room for others."""
        come = _LOOK
        for piece in pieces:
            come += len(piece)
            if come >= _LOOK:
                come = 0
                if shutil.disk_usage(self.folder).free < _LEFT_FREE:
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self.folder))
            yield piece

    @contextlib.contextmanager
    def _partial(self) -> Iterator[tuple[Path, BinaryIO]]:
        """Give a new file in the folder, which is gone afterwards unless it was put somewhere."""
        believed.make_reached(self.folder)
        partial = self.folder / f"{secrets.token_hex(8)}.part"
        try:
            with open(os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
                yield partial, file
        finally:
            partial.unlink(missing_ok=True)

    def _keep(self, partial: Path, blob: Blob) -> Blob:
        """Put a file that was compared in its place."""
        os.replace(partial, blob.path)
        with open_regular(blob.path) as file:
            self._known[blob.path] = identity_of(file.fileno()), blob
        self._make_room()
        return blob

    @contextlib.contextmanager
    def turn(self, digest: str) -> Iterator[None]:
        """Wait until nobody else in this run gets this content; then it is there, or the caller gets it."""
        with self._turns.turn(digest):
            yield

    def _path(self, digest: str, *, raw: bool = False) -> Path:
        match = _DIGEST.fullmatch(digest)
        if match is None:
            raise ValueError(f"{digest[:80]!r} is no sha256 digest")
        return self.folder / f"{match[1]}{'.raw' if raw else ''}.gz"

    def _make_room(self) -> None:
        """Remove the least recently used, but none that this process has used: it may be about to be sent."""
        with self._lock:
            for path in self.folder.glob("*.part"):
                with contextlib.suppress(OSError):  # another process may have removed it
                    if time.time() - path.stat().st_mtime > _ABANDONED_S:
                        path.unlink()
            found = self._kept()
            total = sum(size for _, size, _ in found)
            used = {blob.path for _, blob in list(self._known.values())}
            for _, size, path in sorted(found):
                if total <= self._most:
                    return
                if path not in used:
                    path.unlink(missing_ok=True)
                    total -= size

    def _kept(self) -> list[tuple[int, int, Path]]:
        """Return when each file was last used, its bytes, and its path."""
        found = []
        for path in self.folder.glob("*.gz") if self._is_ours() else ():
            with contextlib.suppress(OSError):  # another process may have removed it
                about = path.lstat()
                found.append((about.st_atime_ns, about.st_size, path))
        return found


def default_folder() -> Path:
    """Return where the user's cache is."""
    return private.cache_folder() / "blobs"
