"""Which recordings among what came home were never closed, because their recorder was killed; MCAP is recovered beside.

Takes files that were put in a folder right before, of somebody else's making; reads a few bytes of each. A program is
named only for what does no harm with it: `rosbag reindex` runs what message definitions of a bag before version 2.0
say, and SQLite removes a file that a journal names.

Source: ROS 1's "Bag Format 2.0"; SQLite's "Database File Format", "The Rollback Journal", and its `pager.c`.
"""

from __future__ import annotations

import errno
import posixpath
import re
import struct
from collections.abc import Sequence, Set
from pathlib import Path

from msgspec.structs import replace

from srprov.record.mcap import MAGIC, TooManyRecordsError, recover
from srprov.record.results import Kept

_BAG = b"#ROSBAG V2.0\n"
_BAG_HEADER = 4096 + 128
_INDEX = re.compile(rb"\x12\x00\x00\x00index_pos=(.{8})", re.DOTALL)
_SUPER_JOURNAL = bytes.fromhex("d9d505f920a163d7")
"""The end of a rollback journal that names a further one; no recorder writes to several databases at once."""
_IN_THE_WAY = {errno.EISDIR, errno.ENOTDIR, errno.EEXIST, errno.ENOTEMPTY, errno.ENAMETOOLONG}
_KILLED = "its recorder did not close it"


def checked(folder: Path, kept: Sequence[Kept], parts: Path) -> list[Kept]:
    """Return the entries of a result, with what is to be said of recordings among them.

    Args:
        folder: Where they are.
        kept: The entries.
        parts: A folder for what is not whole, on the same disk.

    Raises:
        OSError: A recovered file cannot be written.
    """
    names = {one.name for one in kept if one.name}
    taken = {name.casefold() for name in names | _folders(names)}
    found = [_checked(folder, one, names) if one.name else one for one in kept]
    return [_recovered(folder, one, taken, parts) if one.unclosed.startswith("MCAP") else one for one in found]


def _folders(names: Set[str]) -> set[str]:
    """Return all folders above some files; each is looked at once."""
    found: set[str] = set()
    for name in names:
        above = posixpath.dirname(name)
        while above and above not in found:
            found.add(above)
            above = posixpath.dirname(above)
    return found


def in_words(one: Kept) -> str:
    """Return what is wrong with a recording, and what was done about it."""
    return one.unclosed + (f"; what can be read is in {one.recovered}" if one.recovered else "")


def _checked(folder: Path, one: Kept, names: Set[str]) -> Kept:
    path = folder / one.name
    if one.name.endswith(".mcap"):
        return _mcap(folder, one, names)
    if one.name.endswith((".bag", ".bag.active")):
        return replace(one, unclosed=_bag(path))
    if one.name.endswith(".db3-journal") and _ends_with(path, _SUPER_JOURNAL):
        return replace(one, unclosed="SQLite: it names another file, which whoever opens the .db3 beside it removes")
    if one.name.endswith((".db3-wal", ".db3-journal")) and one.size:
        return replace(one, unclosed=f"SQLite: {_KILLED}; keep it beside its .db3")
    if one.name.endswith(".db3") and _lacks_metadata(one.name, names):
        return replace(one, unclosed=f"rosbag2: no metadata.yaml, {_KILLED}; ros2 bag reindex makes it")
    return one


def _recovered(folder: Path, one: Kept, taken: Set[str], parts: Path) -> Kept:
    """Recover a recording beside it, unless that takes the place of something that came home."""
    name = f"{one.name.removesuffix('.mcap')}.recovered.mcap"
    refused = replace(one, unclosed=f"{one.unclosed}; it was not recovered: {name} is in the way")
    if name.casefold() in taken:
        return refused
    part = parts / "recovered"
    try:
        return replace(one, recovered=name) if recover(folder / one.name, folder / name, part) else one
    except TooManyRecordsError:
        part.unlink()
        return replace(one, unclosed=f"{one.unclosed}; it was not recovered: it has too many records that hold nothing")
    except OSError as error:
        if error.errno not in _IN_THE_WAY:
            raise
        part.unlink(missing_ok=True)
        return refused


def _mcap(folder: Path, one: Kept, names: Set[str]) -> Kept:
    path = folder / one.name
    if not _ends_with(path, MAGIC):
        return replace(one, unclosed=f"MCAP: {_KILLED}")
    parent = path.parent.name
    if re.fullmatch(rf"{re.escape(parent)}_[0-9]+\.mcap", path.name) and _lacks_metadata(one.name, names):
        return replace(one, unclosed=f"rosbag2: no metadata.yaml, {_KILLED}; ros2 bag reindex makes it")
    return one


def _lacks_metadata(name: str, names: Set[str]) -> bool:
    return posixpath.join(posixpath.dirname(name), "metadata.yaml") not in names


def _ends_with(path: Path, end: bytes) -> bool:
    with path.open("rb") as stream:
        size = stream.seek(0, 2)
        stream.seek(max(0, size - len(end)))
        return size > len(end) and stream.read() == end


def _bag(path: Path) -> str:
    """Say what is wrong with a ROS 1 bag; the recorder writes last where its index is."""
    with path.open("rb") as stream:
        head = stream.read(_BAG_HEADER)
    if not head.startswith(_BAG):
        return "ROS 1 bag: it does not begin as one of version 2.0 does"
    found = _INDEX.search(head)
    if found is None or struct.unpack("<Q", found[1])[0] == 0:
        return "ROS 1 bag: it has no index; rosbag reindex makes one in a copy of it"
    return f"ROS 1 bag: {_KILLED}" if path.name.endswith(".active") else ""
