"""A tar from a container -> one for whoever unpacks it, such as another container's engine: all lies where it says.

Takes pieces of a tar that a stranger's container, or the robot in between, filled; gives pieces of one that is written
here, so that every reader has what was checked. It has one top, which has the name that the user copies; each further
entry lies in folders that came before as folders, and comes once. So no link leads what follows it elsewhere. A device
is left out: its number is another one's disk on another robot.

Source: POSIX.1-2008, "pax Interchange Format".
"""

from __future__ import annotations

import re
import tarfile
from collections.abc import Iterator, Mapping

from srprov.codes import Code
from srprov.controller.copied import Copied
from srprov.controller.copied_out import MOST_MEMBERS
from srprov.errors import UsageError
from srprov.transport.tar_stream import TarError, TarStream, parts_of, place_of

_DEVICES = (tarfile.CHRTYPE, tarfile.BLKTYPE)
_KINDS = (tarfile.REGTYPE, tarfile.DIRTYPE, tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.FIFOTYPE, *_DEVICES)
_TOPS = (tarfile.REGTYPE, tarfile.DIRTYPE)
_KEPT = re.compile(r"uid|gid|mtime|uname|gname|SCHILY\.xattr\.[\w.-]{1,200}", re.ASCII)
"""Words of an extended header that are passed on; names and sizes are written anew."""
_NUMBERS = {"uid": re.compile("[0-9]{1,10}"), "gid": re.compile("[0-9]{1,10}"),
            "mtime": re.compile("-?[0-9]{1,12}([.][0-9]{1,9})?")}  # fmt: skip


def passed_on(chunks: Iterator[bytes], name: str, copied: Copied) -> Iterator[bytes]:
    """Yield a tar of what an engine sends.

    Args:
        chunks: Its tar: one file, or one folder with all below it.
        name: What that is called; empty: it is the root of a container.
        copied: Is told what is left out.

    Raises:
        UsageError: The tar is none, or has an entry that lies elsewhere; what came before was passed on.
    """
    tar, places = TarStream(chunks, most_members=MOST_MEMBERS, any_kind=True), _Places(name)
    try:
        for header in tar:
            written = places.header(header)
            if header.type in _DEVICES:
                copied.leave_out(header.name, "a device")
                continue
            yield written
            yield from tar.content()
            yield bytes(-header.size % tarfile.BLOCKSIZE)
    except TarError as error:
        raise UsageError(f"what the container's engine sends is not understood: {error}", code=Code.ANSWER) from error
    yield bytes(2 * tarfile.BLOCKSIZE)


class _Places:
    """What has come by now."""

    def __init__(self, name: str) -> None:
        self._name, self._top = name, list[str]()
        self._kinds: dict[str, bytes] = {}
        """Place -> what is there."""

    def header(self, one: tarfile.TarInfo) -> bytes:
        """Return the header of an entry as it is passed on.

        Raises:
            TarError: It has no place in the tar.
        """
        kind = tarfile.REGTYPE if one.type == tarfile.AREGTYPE else one.type  # as old programs wrote a file
        if kind not in _KINDS:
            raise TarError(f"{one.name[:80]!r} is of a kind that no file has")
        if not self._kinds:
            self._top = parts_of(one.name)[:1]
        place = self._place(one.name)
        if place in self._kinds or (kind not in _TOPS if not self._kinds else not self._lies_in_folders(place)):
            raise TarError(f"{one.name[:80]!r} comes twice, or lies in no folder that came before")
        link = one.linkname if kind == tarfile.SYMTYPE else ""
        if kind == tarfile.LNKTYPE:
            link = self._place(one.linkname)
            if self._kinds.get(link) != tarfile.REGTYPE:
                raise TarError(f"{one.name[:80]!r} is another name of what is no file")
        # another name of a file is one, too
        self._kinds[place] = tarfile.REGTYPE if kind == tarfile.LNKTYPE else kind
        return _written(one, kind, place or ".", link)

    def _place(self, name: str) -> str:
        return "/".join(place_of(name, self._top, self._name))

    def _lies_in_folders(self, place: str) -> bool:
        above = place.rpartition("/")[0]
        return self._kinds.get(above) == tarfile.DIRTYPE  # which lay in folders when it came


def _written(one: tarfile.TarInfo, kind: bytes, name: str, link: str) -> bytes:
    new = tarfile.TarInfo(name)
    new.type, new.linkname, new.size = kind, link, one.size
    new.mode, new.uid, new.gid, new.mtime = one.mode & 0o7777, max(0, one.uid), max(0, one.gid), max(0, one.mtime)
    new.uname, new.gname = one.uname, one.gname
    new.pax_headers = _words(one.pax_headers)
    try:
        return new.tobuf(tarfile.PAX_FORMAT, "utf-8", "surrogateescape")
    except ValueError as error:  # a number that a header has no room for
        raise TarError(f"{one.name[:80]!r} cannot be written: {error}") from error


def _words(words: Mapping[str, str]) -> dict[str, str]:
    kept = {key: word for key, word in words.items() if _KEPT.fullmatch(key)}
    return {key: word for key, word in kept.items() if key not in _NUMBERS or _NUMBERS[key].fullmatch(word)}
