"""A run of trials' journal: the truth about it, an event a line, each on the disk before the next act.

Appends to one file, and reads it again. A line is one write, then fsync; what a killed run left of a last line is cut
off, and said.
"""

from __future__ import annotations

import fcntl
import io
import json
import os
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from srprov import regular_file
from srprov.codes import Code
from srprov.errors import UsageError
from srprov.secret import redacted
from srprov.untrusted import mapping, parse_json

NAME = "journal.jsonl"
_MOST_BYTES = 512 << 20
_NEWLINE = b"\n"
_PIECE = 1 << 20


class Journal:
    """An open journal; a context manager. What cannot be written ends the run: nothing is lost without a word."""

    def __init__(self, folder: Path, first: int = 1) -> None:
        """Open it, or make it; `first` is the number of the next event.

        Raises:
            OSError: It cannot be opened.
            UsageError: Somebody else has it open, or has added events since it was read.
        """
        self._path = folder / NAME
        self._descriptor = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW, 0o600)
        self._number = first
        try:
            self._take()
        except BaseException:
            self.close()
            raise

    def _take(self) -> None:
        try:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise UsageError(
                f"another srprov works in {self._path.parent}", hint="wait until it has ended", code=Code.LOCKED
            ) from None
        lines = sum(piece.count(_NEWLINE) for piece in iter(lambda: os.read(self._descriptor, _PIECE), b""))
        if lines != self._number - 1:
            message = f"another srprov has worked in {self._path.parent} meanwhile"
            raise UsageError(message, hint="go on with --resume once more", code=Code.LOCKED)

    def add(self, event: str, **more: object) -> None:
        """Write one event, and wait until it is on the disk.

        Raises:
            OSError: It is not.
        """
        about = {"seq": self._number, "utc": _utc(), "monotonic": round(time.monotonic(), 3), "event": event}
        line = json.dumps({**about, **mapping(redacted(more))}, allow_nan=False) + "\n"
        data = line.encode("utf-8", "replace")
        if os.write(self._descriptor, data) != len(data):
            raise OSError(28, "No space left on device", str(self._path))
        os.fsync(self._descriptor)
        self._number += 1

    def close(self) -> None:
        """Close it."""
        os.close(self._descriptor)

    def __enter__(self) -> Journal:
        """Return itself."""
        return self

    def __exit__(self, *_error: object) -> None:
        """Close it."""
        self.close()


def read(folder: Path) -> tuple[list[Mapping[str, Any]], bool]:
    """Return the events of a journal, and whether its last line was torn, which is then cut off.

    Raises:
        UsageError: There is none, or it is broken elsewhere than at its end.
    """
    whole, torn = _content(folder, _MOST_BYTES)
    events = list(_events(folder / NAME, whole))
    if torn:
        descriptor = os.open(folder / NAME, os.O_WRONLY | os.O_NOFOLLOW)
        os.ftruncate(descriptor, len(whole))
        os.close(descriptor)
    return events, bool(torn)


def look(folder: Path, most: int) -> Iterator[Mapping[str, Any]]:
    """Return the events of a journal of at most `most` bytes one by one, without a torn line; nothing is changed.

    Raises:
        UsageError: There is none, it is larger, or it is broken elsewhere than at its end.
    """
    yield from _events(folder / NAME, _content(folder, most)[0])


def _content(folder: Path, most: int) -> tuple[bytes, bytes]:
    """Return a journal's whole lines, and what there is of one that was torn."""
    path = folder / NAME
    if path.is_symlink():
        raise UsageError(
            f"{path} is a link", hint="it is not what a run wrote; begin a new one", code=Code.STRANGE_FILE
        )
    try:
        data = regular_file.read(path, most)
    except OSError as error:
        raise UsageError(
            f"{path} cannot be read: {error.strerror}", hint="name the folder of a run of trials", code=Code.RECORD
        ) from None
    end = data.rfind(_NEWLINE) + 1
    return data[:end], data[end:]


def _events(path: Path, whole: bytes) -> Iterator[Mapping[str, Any]]:
    for number, line in enumerate(io.BytesIO(whole), start=1):
        yield _event(path, number, line.removesuffix(_NEWLINE))


def _event(path: Path, number: int, line: bytes) -> Mapping[str, Any]:
    try:
        event = mapping(parse_json(line.decode(), wide=True))  # a metric may be any number
    except ValueError:
        event = {}
    if event.get("seq") != number or not isinstance(event.get("event"), str):
        raise UsageError(
            f"{path}:{number} is not the event number {number}",
            hint="the journal was changed by somebody",
            code=Code.RECORD,
        )
    return event


def _utc() -> str:
    now = time.time()
    return time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(now)) + f".{int(now * 1000) % 1000:03d}+00:00"
