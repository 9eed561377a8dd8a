"""Data sets on this machine: which file has which sha256, and those that were downloaded.

Both lie below `$XDG_CACHE_HOME/srprov/data`, private to the user: `known.json` has what files were when they were last
hashed, and a download has its sha256 as name, and beside it the addresses that gave it. Whoever takes one compares it
again: the robot that gets it does. A hash is no secret, records tell it: who names an address gets what that gives, and
no file of this machine.
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

from srprov import believed, private, regular_file
from srprov.untrusted import json_or_none, mapping, strings

MOST_BYTES = 64 << 30
"""Of one data set."""
SHA256 = re.compile("[0-9a-f]{64}")
_MOST_KNOWN = 8 << 20
_MOST_GIVERS = 100
_PIECE = 1 << 20


class WrongData(Exception):
    """What came is not what was asked for; the text says how."""


def folder() -> Path:
    """Return where downloads and the list of known files are."""
    return Path(os.path.realpath(_named()))


def _named() -> Path:
    """Return the same as its name is, by way of which links ever."""
    return private.cache_folder() / "data"


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
    text = json.dumps(known)
    if len(text) > _MOST_KNOWN:
        text = json.dumps({path: known[path]})  # it begins anew, or nothing would be kept any more
    with contextlib.suppress(OSError):  # it is read again next time
        believed.write(_named() / "known.json", text, _MOST_KNOWN)
    return found.hexdigest(), identity[2]


def find(sha256: str, url: str = "") -> Path | None:
    """Return a file that has this hash.

    With an address, that is what was downloaded there; without, a file that had it when it was hashed and did not
    change since.
    """
    if url:
        kept = folder() / sha256
        return kept if SHA256.fullmatch(sha256) and url in _givers(sha256) and kept.is_file() else None
    for path, entry in _known().items():
        if isinstance(entry, list) and entry[-1:] == [sha256]:
            with contextlib.suppress(OSError):
                if _identity(os.stat(path, follow_symlinks=False)) == entry[:-1]:
                    return Path(path)
    return None


def keep(sha256: str, pieces: Iterable[bytes], url: str) -> Path:
    """Keep a download, and the address that gave it.

    Raises:
        WrongData: It has another hash, or is too large; nothing is kept.
        OSError: It cannot be written.
    """
    believed.make_folder(_named())
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
        addresses = sorted({*_givers(sha256), url})[-_MOST_GIVERS:]
        private.replace_file(folder() / f"{sha256}.json", json.dumps(addresses))
    finally:
        part.unlink(missing_ok=True)
    return folder() / sha256


def forget(sha256: str) -> None:
    """Remove a download that a robot found to be another content."""
    for name in (f"{sha256}.json", sha256):
        (folder() / name).unlink(missing_ok=True)


def _givers(sha256: str) -> list[str]:
    """Return the addresses that gave a download."""
    try:
        text = believed.read(_named() / f"{sha256}.json", _MOST_KNOWN).decode("utf-8", "replace")
    except OSError:
        return []
    return strings(json_or_none(text))


def _identity(about: os.stat_result) -> list[int]:
    return [about.st_dev, about.st_ino, about.st_size, about.st_mtime_ns, about.st_ctime_ns]


def _known() -> dict[str, object]:
    try:
        text = believed.read(_named() / "known.json", _MOST_KNOWN).decode("utf-8", "replace")
    except OSError:
        return {}
    return dict(mapping(json_or_none(text)))
