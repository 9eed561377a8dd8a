"""Files of a result, brought from a robot into a folder: those that are missing there, or have another content.

Takes a robot, a place and its listing; writes below the folder. A file is put in its place when its hash is the
robot's. What has come of a large one stays, also when this ends before it is whole: the next call goes on from there.
"""

from __future__ import annotations

import errno
import posixpath
import shutil
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path

import msgspec
from msgspec.structs import replace

from srprov.execution.collect import CollectFailed, Place, Robot, TransferCut, fetch_file, fetch_tar, listings
from srprov.execution.listing import MOST_FILES, MOUNT, UNREAD, Entry
from srprov.record.results import DEEPEST, MOST_FOLDERS, Kept, Names, TooManyFolders, is_here, open_part, put, sync
from srprov.transport.tar_stream import TarError, TarStream

_MARGIN = 64 << 20
"""Bytes that stay free here, whatever comes."""
_LARGE = 8 << 20
"""Bytes of a file that is fetched alone, and gone on with."""
_FEW = 20
"""Files that are fetched alone where others need not come."""
_ENTRY = 16 << 10
"""Bytes that a tar may hold for an entry beside its content: headers, and extended ones with its names."""
_WHOLE = 1 << 20
_STEP = 64 << 20
_IN_THE_WAY = {errno.EISDIR, errno.ENOTDIR, errno.EEXIST, errno.ENOTEMPTY, errno.ENAMETOOLONG}
_NOT_READ = {
    MOUNT: "something else is mounted there, and what lies in it did not come: mount that in the container by itself",
    UNREAD: "a folder in it cannot be read: who logs in on the robot may not, or its disk fails",
}
"""Kind of an entry -> why it does not come."""
CHANGED = "it changed while it was read"
"""Note of what could not be fetched for this reason."""
Say = Callable[[str], None]


class Home(msgspec.Struct, frozen=True):
    """Where files come, and whom to tell how far it is."""

    parts: Path
    """A folder for what is not whole, for this robot's service alone."""
    say: Say = lambda _text: None


class Bringing:
    """One result on its way, and what became of each entry."""

    def __init__(self, robot: Robot, place: Place, folder: Path, home: Home, apart: Collection[str] = ()) -> None:
        """Take a place on a robot, where its files go, and the folders in it that are another mount's."""
        self._robot, self._place, self._folder, self._home, self._apart = robot, place, folder, home, apart
        self.fetched_files = self.fetched_bytes = 0
        """What came; the others were here."""
        self._told = self._came = 0
        self._refused: dict[str, str] = {}

    def all(self, entries: list[Entry]) -> list[Kept] | None:
        """Bring what was listed; of what changed meanwhile, what a second listing says.

        None: by then all of it is gone, and nothing came.

        Raises:
            CollectFailed, EquipmentFailed: The robot does not give it.
            OSError: Something cannot be written here.
        """
        kept = self.once(entries)
        if any(one.note == CHANGED for one in kept):
            (again,) = listings(self._robot, [self._place])
            if again is None:
                return [one for one in kept if one.note != CHANGED] or None
            kept = self.once(again)
        return kept

    def once(self, entries: list[Entry]) -> list[Kept]:
        """Bring what was listed; what changed meanwhile is named, and so is what a link did not carry."""
        names = Names()
        try:
            kept = {one.path: _listed(one, names) for one in entries}
        except TooManyFolders as error:
            raise CollectFailed(f"{self._robot.host}: {self._place.path}: {error}") from None
        wanted = {
            one.path: one
            for one in entries
            if kept[one.path].name and not is_here(self._folder / kept[one.path].name, one.size, one.sha256)
        }
        self._check_room(sum(one.size for one in wanted.values()))
        small = {path: one for path, one in wanted.items() if one.size < _LARGE}
        if len(small) <= _FEW and len(small) < sum(one.is_file for one in entries):
            small = {}
        came, why = set[str](), CHANGED
        try:
            if small:
                self._tar(small, kept, entries, came)
            for path, one in wanted.items():
                if path not in small and self._file(one, kept[path]):
                    came.add(path)
        except TransferCut as error:
            why = f"{error}; what came of it is kept"
        sync([self._folder / kept[path].name for path in came])
        self.fetched_files += len(came)
        self.fetched_bytes += sum(wanted[path].size for path in came)
        for path in wanted.keys() - came:
            note = self._refused.get(path, why)
            kept[path] = replace(kept[path], name="", sha256="", note=note, failed=True)
        return list(kept.values())

    def _check_room(self, need: int) -> None:
        near = next(one for one in (self._folder, *self._folder.parents) if one.exists())
        if shutil.disk_usage(near).free < need + _MARGIN:
            raise CollectFailed(f"{self._robot.host}: {self._place.path} has {need} bytes, and there is no room here")

    def _tar(self, wanted: Mapping[str, Entry], kept: Mapping[str, Kept], entries: list[Entry], came: set[str]) -> None:
        """Fetch small files in one stream; add the paths of those that are here now to `came`."""
        without = [one.path for one in entries if one.kind == MOUNT or (one.is_file and one.path not in wanted)]
        most = sum(one.size for one in wanted.values()) + (2 * len(entries) + MOST_FOLDERS) * _ENTRY
        pieces = self._counted(fetch_tar(self._robot, self._place, (*without, *self._apart), most))
        try:
            for member in (archive := TarStream(pieces, most_members=2 * MOST_FILES, any_kind=True)):
                path = member.name.removeprefix("./").strip("/")
                entry = wanted.get(path)
                alike = entry and member.isreg() and member.size == entry.size and path not in came
                if entry and alike and self._member(entry, archive.content(), kept[path]):
                    came.add(path)
        except TarError as error:
            raise CollectFailed(f"{self._robot.host}: {self._place.path}: {error}") from error

    def _member(self, entry: Entry, content: Iterator[bytes], kept: Kept) -> bool:
        part = self._home.parts / "small"
        stream, digest = open_part(part)
        with stream:
            for piece in content:
                digest.update(piece)
                stream.write(piece)
        return digest.hexdigest() == entry.sha256 and self._put(part, kept)

    def _file(self, entry: Entry, kept: Kept) -> bool:
        """Fetch one file, from where an earlier call ended; return whether it is here now."""
        path = posixpath.join(posixpath.dirname(self._place.path), entry.path)
        place = replace(self._place, path=path)
        part = self._home.parts / entry.sha256
        stream, digest = open_part(part, _WHOLE)
        with stream:
            try:
                for piece in self._counted(fetch_file(self._robot, place, entry.size, stream.tell())):
                    digest.update(piece)
                    stream.write(piece)
            except TransferCut:  # what came of it stays
                raise
            except CollectFailed:  # it is gone, or another by now: a second listing says so
                digest.update(b"\0")
        if digest.hexdigest() != entry.sha256:
            part.unlink()
            return False
        return self._put(part, kept)

    def _put(self, part: Path, kept: Kept) -> bool:
        try:
            put(part, self._folder / kept.name)
        except OSError as error:
            if error.errno not in _IN_THE_WAY:
                raise
            self._refused[kept.path] = f"it cannot be put here: {error.strerror}"
        return kept.path not in self._refused

    def _counted(self, pieces: Iterator[bytes]) -> Iterator[bytes]:
        for piece in pieces:
            self._came += len(piece)
            if self._came - self._told >= _STEP:
                self._told = self._came
                self._home.say(f"{self._came >> 20} MiB came")
            yield piece


def _listed(one: Entry, names: Names) -> Kept:
    """Return what is to become of an entry; a name for each file that is to come."""
    if one.kind == "l":
        return Kept(path=one.path, note=f"a link to {one.link[:200]}")
    if one.kind in _NOT_READ:
        return Kept(path=one.path, note=_NOT_READ[one.kind], failed=True)
    if not one.is_file:
        return Kept(path=one.path, note="neither file nor folder nor link")
    parts = [part for part in one.path.split("/") if part not in ("", ".")] or ["_"]
    if len(parts) > DEEPEST:
        return Kept(path=one.path, size=one.size, note=f"it lies deeper than {DEEPEST} folders")
    if not one.sha256:
        return Kept(path=one.path, size=one.size, note="it could not be read", failed=True)
    name = names.name(parts)
    note = "" if one.path == name else "its name was changed: here it would be another"
    return Kept(path=one.path, name=name, size=one.size, sha256=one.sha256, note=note)
