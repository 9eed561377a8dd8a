"""Data sets on this machine: which file has which sha256, and those that were downloaded.

Both lie below `$XDG_CACHE_HOME/srprov/data`, private to the user: `known.json` has what files were when they were last
hashed, and a download has its sha256 as name. Whoever takes one compares it again: the robot that gets it does.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import os
import re
import secrets
from collections.abc import Iterable
from pathlib import Path

from srprov import private, regular_file
from srprov.untrusted import json_or_none, mapping

MOST_BYTES = 64 << 30
"""Of one data set."""
SHA256 = re.compile("[0-9a-f]{64}")
_MOST_KNOWN = 8 << 20
_PIECE = 1 << 20


class WrongData(Exception):
    """What came is not what was asked for; the text says how."""


def folder() -> Path:
    """Return where downloads and the list of known files are."""
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return Path(os.path.realpath(base / "srprov" / "data"))


def digest(path: str) -> tuple[str, int]:
    """Return the sha256 and size of a file; one that was hashed before, and did not change since, is not read again.

    Raises:
        OSError: It cannot be read, is no regular file, or changes.
    """
    with regular_file.real_file(path) as file:
        known, identity = _known(), _identity(os.fstat(file.fileno()))
        entry = known.get(path)
        if isinstance(entry, list) and entry[:-1] == identity and SHA256.fullmatch(str(entry[-1])):
            return str(entry[-1]), identity[2]
        found = hashlib.sha256()
        while piece := file.read(_PIECE):
            found.update(piece)
        if _identity(os.fstat(file.fileno())) != identity:
            raise OSError(errno.EBUSY, regular_file.CHANGED, path)
    known[path] = [*identity, found.hexdigest()]
    with contextlib.suppress(OSError):  # it is read again next time
        private.replace_file(folder() / "known.json", json.dumps(known))
    return found.hexdigest(), identity[2]


def find(sha256: str) -> Path | None:
    """Return a file that has this hash: a download, or one that had it when it was hashed and did not change since."""
    kept = folder() / sha256
    if SHA256.fullmatch(sha256) and kept.is_file():
        return kept
    for path, entry in _known().items():
        if isinstance(entry, list) and entry[-1:] == [sha256]:
            with contextlib.suppress(OSError):
                if _identity(os.stat(path, follow_symlinks=False)) == entry[:-1]:
                    return Path(path)
    return None


def keep(sha256: str, pieces: Iterable[bytes]) -> Path:
    """Keep a download.

    Raises:
        WrongData: It has another hash, or is too large; nothing is kept.
        OSError: It cannot be written.
    """
    private.make_folder(folder())
    part, hashed, size = folder() / f"{secrets.token_hex(8)}.part", hashlib.sha256(), 0
    try:
        with open(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
            for piece in pieces:
                size += len(piece)
                if size > MOST_BYTES:
                    raise WrongData(f"it is larger than {MOST_BYTES >> 30} GiB")
                hashed.update(piece)
                file.write(piece)
        if hashed.hexdigest() != sha256:
            raise WrongData(f"its sha256 is {hashed.hexdigest()}, not {sha256}")
        os.replace(part, folder() / sha256)
    finally:
        part.unlink(missing_ok=True)
    return folder() / sha256


def forget(sha256: str) -> None:
    """Remove a download that a robot found to be another content."""
    (folder() / sha256).unlink(missing_ok=True)


def _identity(about: os.stat_result) -> list[int]:
    return [about.st_dev, about.st_ino, about.st_size, about.st_mtime_ns, about.st_ctime_ns]


def _known() -> dict[str, object]:
    try:
        text = regular_file.read(folder() / "known.json", _MOST_KNOWN).decode("utf-8", "replace")
    except OSError:
        return {}
    return dict(mapping(json_or_none(text)))
