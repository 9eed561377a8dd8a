"""Layers of an image -> the files in which it says what is installed in it.

Takes each layer's tar once; gives the few files of it that count, and what it takes away of those below. What is in
a layer is the image's own word: it is bounded, and nothing of it is run.

Source: OCI Image Format Specification, "Whiteouts"; Debian Policy, "/var/lib/dpkg/status"; apk-tools, "installed";
PyPA, "Recording installed projects"; REP 149.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, field

import msgspec

from srprov.oci.members import Members

_DATABASES = re.compile(
    r"(?:usr/)?(?:etc|lib)/os-release|var/lib/dpkg/status|var/lib/dpkg/status\.d/[^/]+|(?:usr/)?lib/apk/db/installed"
    r"|(?:.*/)?[^/]+\.dist-info/(?:METADATA|INSTALLER)|(?:.*/)?[^/]+\.egg-info(?:/PKG-INFO)?"
    r"|(?:.*/)?lib/node_modules/(?:@[^/]+/)?[^/]+/package\.json|(?:.*/)?share/[^/]+/package\.xml"
)
_WHITEOUT, _OPAQUE = ".wh.", ".wh..wh..opq"
_LONGEST = 32 << 20
"""Bytes of one file."""
_MOST_BYTES = 96 << 20
_MOST_OF_ALL = 128 << 20
"""Of all layers of a bundle together."""
_MOST_FILES = 50_000
_LONGEST_PATH = 1024


class Layer(msgspec.Struct, frozen=True):
    """What of a layer counts."""

    files: Mapping[str, bytes]
    """Path -> content of what says something of packages."""
    gone: frozenset[str] = frozenset()
    """Files and folders that it takes away of layers below."""
    emptied: frozenset[str] = frozenset()
    """Folders of which nothing below is left."""
    unread: str = ""
    """Why it could not be read to its end, or nothing."""

    @property
    def work(self) -> int:
        """How much there is to be looked at of it, for each image that has it."""
        return len(self.files) + len(self.gone) + len(self.emptied)


@dataclass(slots=True)
class Room:
    """How many bytes of files may still be kept, of all layers of a bundle: many may unpack to the most of one."""

    left: int = _MOST_OF_ALL


@dataclass(slots=True)
class _Reading:
    """What was found so far."""

    room: Room
    files: dict[str, bytes] = field(default_factory=dict)
    gone: set[str] = field(default_factory=set)
    emptied: set[str] = field(default_factory=set)
    size: int = 0


def read(pieces: Iterable[bytes], room: Room) -> Layer:
    """Read a layer to its end; one that is odd is given as far as it could be read, and the rest of it is passed over.

    Args:
        pieces: Of its tar.
        room: For what is kept of it.

    Raises:
        ValueError: Whatever gives the pieces raises it.
    """
    found, why, source = _Reading(room), "", _Watched(pieces)
    try:
        _read(Members(source), found)
    except ValueError as error:
        if source.failed:
            raise
        why = str(error)
        for _ in source:
            pass
    return Layer(found.files, frozenset(found.gone), frozenset(found.emptied), why)


class _Watched:
    """Pieces, and whether it was they that failed."""

    def __init__(self, pieces: Iterable[bytes]) -> None:
        self._pieces, self.failed = iter(pieces), False

    def __iter__(self) -> _Watched:
        return self

    def __next__(self) -> bytes:
        try:
            return next(self._pieces)
        except ValueError:
            self.failed = True
            raise


def _read(members: Members, found: _Reading) -> None:
    for one in members:
        folder, _, name = one.path.rpartition("/")
        if name == _OPAQUE:
            found.emptied.add(folder)
        elif name.startswith(_WHITEOUT):
            found.gone.add(f"{folder}/{name[len(_WHITEOUT) :]}".removeprefix("/"))
        elif len(one.path) <= _LONGEST_PATH and _DATABASES.fullmatch(one.path):
            if one.is_file:
                found.size += one.size
                found.room.left -= one.size
                if one.size > _LONGEST or found.size > _MOST_BYTES or found.room.left < 0:
                    raise ValueError("its lists of packages are longer than any sensible ones")
                found.files[one.path] = b"".join(members.content())
            elif not one.is_folder:  # a link, in the place of what was there
                found.files.pop(one.path, None)
                found.gone.add(one.path)
        if len(found.files) + len(found.gone) + len(found.emptied) > _MOST_FILES:
            raise ValueError(f"more than {_MOST_FILES} files in it say something of packages, or are taken away")


def merged(layers: Sequence[Layer]) -> dict[str, bytes]:
    """Return path -> content in the whole image, of its layers from the base up.

    A folder that a layer replaces by a link is not noticed: its files stay. Each file is looked at once, against all
    that the layers above it take away, however many they are. A layer that comes again adds nothing below itself.
    """
    found: dict[str, bytes] = {}
    gone, emptied = set[str](), set[str]()
    for one in {id(one): one for one in reversed(layers)}.values():
        for path, data in one.files.items():
            if path not in found and not _hidden(path, gone, emptied):
                found[path] = data
        gone |= one.gone
        emptied |= one.emptied
    return {path: found[path] for path in sorted(found)}


def _hidden(path: str, gone: Set[str], emptied: Set[str]) -> bool:
    if path in gone or "" in emptied:
        return True
    folder = path.rpartition("/")[0] if gone or emptied else ""
    while folder:
        if folder in gone or folder in emptied:
            return True
        folder = folder.rpartition("/")[0]
    return False
