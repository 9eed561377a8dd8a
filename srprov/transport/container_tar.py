"""Tars for a container: which may go to its engine, and one of the user's written anew for its robot's own `tar`.

Takes pieces of a tar that may be a stranger's; gives pieces. An engine before 29.5.1 takes a tar for compressed by its
first bytes, be they the name of a file, and runs the container's own programs to unpack that (CVE-2026-41567).
"""

from __future__ import annotations

import io
import itertools
import tarfile
from collections.abc import Callable, Iterator

from srprov.codes import Code
from srprov.errors import UsageError
from srprov.transport.tar_stream import TarError, parts_of

BEGIN = tarfile.TarInfo.create_pax_global_header({"comment": "srprov"})
"""An entry that says nothing, which every reader passes over: no name of a file is the beginning of a tar then."""
_BLOCK, _RECORD, _PIECE = 512, 10_240, 1 << 20
_LONGEST_PATH = 4096
_KINDS = {
    tarfile.AREGTYPE: tarfile.REGTYPE, tarfile.CONTTYPE: tarfile.REGTYPE, tarfile.GNUTYPE_SPARSE: tarfile.REGTYPE,
    **{kind: kind for kind in (tarfile.REGTYPE, tarfile.DIRTYPE, tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.CHRTYPE,
                               tarfile.BLKTYPE, tarfile.FIFOTYPE)},
}  # fmt: skip
Check = Callable[[list[str], bool], None]
"""Refuses a place in the tar, by its parts, and whether a folder is to be there."""


def begun(chunks: Iterator[bytes]) -> Iterator[bytes]:
    """Return the same pieces, of which the first ones were looked at.

    Raises:
        UsageError: They do not begin as a tar does.
    """
    first = b""
    while len(first) < _BLOCK and (piece := next(chunks, None)) is not None:
        first += piece
    try:
        if len(first) < _BLOCK or first[:_BLOCK].strip(b"\0"):  # a tar without entries has blocks of zeros alone
            tarfile.TarInfo.frombuf(first[:_BLOCK], "utf-8", "surrogateescape")
    except (tarfile.TarError, ValueError) as error:
        raise _no_tar(error) from error
    return itertools.chain([first], chunks)


def written_anew(chunks: Iterator[bytes], check: Check) -> Iterator[bytes]:
    """Yield a tar with the same entries, each of which was checked, and lies where its name says.

    Raises:
        UsageError: It is no tar, or has an entry that cannot be unpacked; what came before was passed on.
    """
    size = 0
    try:
        with tarfile.open(
            fileobj=_Pieces(chunks), mode="r|", tarinfo=_Entry, encoding="utf-8", errors="surrogateescape"
        ) as tar:
            while (entry := tar.next()) is not None:
                tar.members.clear()  # type: ignore[attr-defined]  # it would keep all of them
                parts = parts_of(entry.name)
                if parts or not entry.isdir():
                    check(parts, entry.isdir())
                for piece in _entry(tar, entry, parts):
                    size += len(piece)
                    yield piece
    except (tarfile.TarError, TarError, ValueError, EOFError) as error:
        raise _no_tar(error) from error
    yield bytes(2 * _BLOCK + -(size + 2 * _BLOCK) % _RECORD)


def _entry(tar: tarfile.TarFile, entry: tarfile.TarInfo, parts: list[str]) -> Iterator[bytes]:
    kind = _KINDS.get(entry.type)
    if kind is None or len(entry.name) > _LONGEST_PATH or "\0" in entry.name + entry.linkname:
        raise TarError(f"{entry.name[:80]!r} is of a kind that no file has")
    new = tarfile.TarInfo("/".join([".", *parts]))
    new.type, new.size = kind, entry.size if kind == tarfile.REGTYPE else 0
    new.linkname = "/".join([".", *parts_of(entry.linkname)]) if kind == tarfile.LNKTYPE else entry.linkname
    new.mode, new.uid, new.gid, new.mtime = entry.mode & 0o7777, entry.uid, entry.gid, entry.mtime
    new.devmajor, new.devminor = entry.devmajor, entry.devminor
    yield new.tobuf(tarfile.PAX_FORMAT, "utf-8", "surrogateescape")
    content, left = tar.extractfile(entry) if new.size else None, new.size
    while content is not None and left:
        piece = content.read(min(left, _PIECE))
        if not piece:
            raise TarError("it ends too early")
        left -= len(piece)
        yield piece
    yield bytes(-new.size % _BLOCK)


class _Entry(tarfile.TarInfo):
    """An entry of which no header can be misread for the end of the tar, as `tarfile` does behind the first one."""

    @classmethod
    def fromtarfile(cls, tar: tarfile.TarFile) -> _Entry:
        try:
            return super().fromtarfile(tar)
        except tarfile.InvalidHeaderError as error:  # type: ignore[attr-defined]  # its stubs lack it
            raise TarError(str(error)) from error


class _Pieces(io.RawIOBase):
    """Pieces as a file that is read from."""

    def __init__(self, chunks: Iterator[bytes]) -> None:
        self._chunks, self._rest = chunks, memoryview(b"")

    def read(self, size: int = -1) -> bytes:
        while not self._rest and (piece := next(self._chunks, None)) is not None:
            self._rest = memoryview(piece)
        now, self._rest = self._rest[:size], self._rest[size:]
        return bytes(now)


def _no_tar(error: Exception) -> UsageError:
    return UsageError(
        f"what is to be unpacked is no tar: {error}",
        hint="a compressed one is unpacked before: zcat it.tar.gz | srprov cp FILE - SERVICE:/folder",
        code=Code.NO_FILE,
    )
