"""What is in the folder of a run, or in a bundle: names, sizes and contents, read within limits.

A bundle is a stranger's. The folder of a run is one's own; links in it are refused all the same.
"""

from __future__ import annotations

import hashlib
import io
import os
import re
import stat
from bisect import bisect_left
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, BinaryIO, Protocol

import msgspec

from srprov import regular_file
from srprov.codes import Code
from srprov.errors import UsageError, visible
from srprov.evidence import stored_zip
from srprov.untrusted import mapping, parse_json

MOST_TEXT = 64 * regular_file.MIB
"""Bytes of a file that is held in memory."""
MOST_JSON = 16 * regular_file.MIB
MOST_JOURNAL = 32 * regular_file.MIB
MOST_SESSIONS = 200
JOURNAL = "journal.jsonl"
MANIFEST = "manifest-sha256.txt"
SIGNATURE = f"{MANIFEST}.sig"
CRATE = "ro-crate-metadata.json"
ABOUT = "bundle.json"
_TABLES = ("trials.csv", "metrics.csv", "clocks.csv", "hosts.csv", "containers.csv", "csv-metadata.json")
_FOLDERS = ("sessions", "trials")
_UNFINISHED = re.compile(r"trials/[^/]+/(\.parts/|logs/.*\.part\Z)|[^/]+/[^/]+\.part\Z|sessions/.*\.part\Z")
"""What was fetched or written in part."""


class Files(Protocol):
    """Files by their names, which are relative paths."""

    @property
    def sizes(self) -> Mapping[str, int]:
        """Return name -> bytes, in name order."""

    def pieces(self, name: str) -> Iterator[bytes]:
        """Return a file's content in pieces."""


class NotThere(ValueError):
    """A file that should be there is not, or is not what it should be; the message says so."""


class Undecided(ValueError):
    """A check came to no end; the message says why."""


def content(files: Files, name: str, most: int = MOST_TEXT) -> bytes:
    """Return a file's content.

    Raises:
        NotThere: There is none, or it is too large.
    """
    size = files.sizes.get(name)
    if size is None:
        raise NotThere(f"{name} is missing")
    if size > most:
        raise NotThere(f"{name} is larger than {most >> 20} MiB")
    whole = io.BytesIO()  # not a list of pieces, which would be in memory twice when they are joined
    for piece in files.pieces(name):
        whole.write(piece)
    return whole.getvalue()


def json_of(files: Files, name: str) -> Mapping[str, Any]:
    """Return a file's JSON, which is a map.

    Raises:
        NotThere: There is none.
    """
    text = content(files, name, MOST_JSON).decode("utf-8", "replace")
    try:
        found = parse_json(text, max_characters=MOST_JSON, wide=True)
    except ValueError as error:
        raise NotThere(f"{name}: {error}") from None
    if not isinstance(found, Mapping):
        raise NotThere(f"{name} is no JSON map")
    return mapping(found)


def digest(files: Files, name: str) -> str:
    """Return the sha256 of a file, in hex."""
    made = hashlib.sha256()
    for piece in files.pieces(name):
        made.update(piece)
    return made.hexdigest()


def below(files: Files, folder: str) -> list[str]:
    """Return the names of the files in a folder, whose name ends with `/`."""
    names = list(files.sizes)
    return names[bisect_left(names, folder) : bisect_left(names, folder[:-1] + "0")]  # what follows `/` in ASCII


def sessions(files: Files) -> list[str]:
    """Return the folders of a run's sessions, the last one last.

    Raises:
        NotThere: There are more than anybody has.
    """
    found = {name.split("/")[1] for name in below(files, "sessions/") if name.count("/") > 1}
    if len(found) > MOST_SESSIONS:
        raise NotThere(f"it has more than {MOST_SESSIONS} sessions")
    return [f"sessions/{number}" for number in sorted(found, key=lambda one: (len(one), one))]


class Archive(msgspec.Struct, frozen=True):
    """The files of a bundle that is open."""

    stream: BinaryIO
    entries: Mapping[str, stored_zip.Entry]
    sizes: Mapping[str, int]

    def pieces(self, name: str) -> Iterator[bytes]:
        """Return a file's content in pieces."""
        return stored_zip.content(self.stream, self.entries[name])


def archive(stream: BinaryIO, entries: Iterable[stored_zip.Entry]) -> Archive:
    """Return the files of a bundle."""
    found = {one.name: one for one in entries}
    return Archive(stream, found, {name: found[name].size for name in sorted(found)})


@contextmanager
def opened(path: str) -> Iterator[Archive]:
    """Open a bundle.

    Raises:
        UsageError: It is none, or cannot be read.
    """
    with ExitStack() as stack:
        try:
            stream = stack.enter_context(regular_file.real_file(os.path.realpath(path)))
            found = archive(stream, stored_zip.read(stream))
        except (OSError, ValueError) as error:
            why = error.strerror if isinstance(error, OSError) else error
            hint = "name a file that `srprov bundle` made"
            raise UsageError(f"{path} is no bundle: {visible(str(why))}", hint=hint, code=Code.NO_BUNDLE) from error
        yield found


class Folder(msgspec.Struct, frozen=True):
    """The files of a run's folder that belong to its evidence."""

    path: Path
    sizes: Mapping[str, int]

    def pieces(self, name: str) -> Iterator[bytes]:
        """Return a file's content in pieces."""
        with regular_file.real_file(self.path / name) as stream:
            while piece := stream.read(stored_zip.PIECE):
                yield piece


def of_run(path: Path) -> Folder:
    """Return the files of a run of trials, without what was fetched in part and what srprov did not write.

    Raises:
        UsageError: It has a link, a file with several names, or something that is no file.
        OSError: It cannot be read.
    """
    home = Path(os.path.realpath(path))
    found: dict[str, int] = {}
    for name in (JOURNAL, *_TABLES):
        if (home / name).exists():
            found[name] = _size(home / name)
    for top in (one for one in _FOLDERS if (home / one).is_dir()):
        for place in _files_below(home / top):
            name = place.relative_to(home).as_posix()
            if not _UNFINISHED.match(name):
                found[name] = _size(place)
    return Folder(home, dict(sorted(found.items())))


def _files_below(top: Path) -> Iterator[Path]:
    _check_no_link(top)
    for folder, names, files in regular_file.walk(top, onerror=_raise):
        for one in (*names, *files):
            _check_no_link(Path(folder, one))
        yield from (Path(folder, one) for one in files)


def _check_no_link(path: Path) -> None:
    if path.is_symlink():
        raise UsageError(f"{path} is a link", hint="it is not what srprov wrote: remove it", code=Code.STRANGE_FILE)


def _raise(error: OSError) -> None:
    raise error


def _size(path: Path) -> int:
    about = path.lstat()
    if not stat.S_ISREG(about.st_mode):
        raise UsageError(f"{path} is no file", hint="it is not what srprov wrote: remove it", code=Code.STRANGE_FILE)
    if regular_file.has_further_names(about):  # an archive may have made a file of the user's one of the run
        what = f"{path} has another name (a hard link)"
        raise UsageError(what, hint="srprov makes none: look at it, and remove it", code=Code.STRANGE_FILE)
    return about.st_size
