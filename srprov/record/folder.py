"""A run's folder: files appear whole, events line by line, all of it readable by its owner only.

Takes names and functions that make their text; writes in a thread, in order. A file is written beside its place and
renamed, so that what a killed run leaves is complete as far as it goes; an event is one write to an open file.
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import threading
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Protocol

from srprov import believed, private
from srprov.secret import redact, redacted

_PATIENCE_S = 10.0
"""How long the end of a run waits for its record: a disk that hangs must not hold the user up."""
_MOST_TWINS = 100


def default_root() -> Path:
    """Return where runs are recorded: the user's folder for state, as the XDG base directory specification has it."""
    return private.state_folder() / "runs"


def in_lines(value: object, depth: int = 2) -> str:
    """Return JSON with a line for every item of the upper levels: easy to read, and much faster than a full indent."""
    if depth and value and isinstance(value, dict):
        inner = (f"{json.dumps(str(key))}: {in_lines(item, depth - 1)}" for key, item in value.items())
        return "{\n" + ",\n".join(inner) + "\n}"
    if depth and value and isinstance(value, list):
        return "[\n" + ",\n".join(in_lines(item, depth - 1) for item in value) + "\n]"
    return json.dumps(value)


class Sink(Protocol):
    """Where a record is written."""

    def put(self, name: str, make: Callable[[], str]) -> None:
        """Write a file without secrets."""

    def put_json(self, name: str, make: Callable[[], object]) -> None:
        """Write a JSON document without secrets."""


class PlainFolder:
    """A folder whose files are written at once, without secrets; OSError where one cannot be."""

    def __init__(self, path: Path) -> None:
        """Take where they lie; it is made with the first."""
        self.path = path

    def put(self, name: str, make: Callable[[], str]) -> None:
        """Write a file; secrets are taken out of it."""
        private.replace_file(self.path / name, redact(make()))

    def put_json(self, name: str, make: Callable[[], object]) -> None:
        """Write a JSON document; secrets are taken out of its texts, so that it stays JSON."""
        private.replace_file(self.path / name, in_lines(redacted(make())) + "\n")


class RunFolder:
    """One run's record; a context manager. Nothing here raises for a disk: the first failure is kept in `problem`."""

    def __init__(self, root: Path, name: str) -> None:
        """Begin to write below `root/name`; a number is added when that is there already."""
        self.root, self.name = root, name
        self.path = root / name
        self.problem = ""
        self._events = -1
        self._cut = False
        self._jobs: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._work, name="record", daemon=True)
        self._jobs.put(self._make)
        self._thread.start()

    def put(self, name: str, make: Callable[[], str]) -> None:
        """Write a file, later; `make` gives its text then, and secrets are taken out of it."""
        self._put(name, lambda: redact(make()))

    def put_json(self, name: str, make: Callable[[], object]) -> None:
        """Write a JSON document, later; secrets are taken out of its texts, so that it stays JSON."""
        self._put(name, lambda: in_lines(redacted(make())) + "\n")

    def _put(self, name: str, make: Callable[[], str]) -> None:
        # after one that could not be written no other is tried, but events are
        self._jobs.put(lambda: None if self.problem else private.replace_file(self.path / name, make()))

    def event(self, value: object) -> None:
        """Add a JSON value as a line to events.jsonl, soon."""
        self._jobs.put(lambda: self._append(json.dumps(redacted(value)) + "\n"))

    def close(self) -> None:
        """Wait until everything is written; safe to call twice."""
        if self._thread.is_alive():
            self._jobs.put(None)
            self._thread.join(_PATIENCE_S)
            if self._thread.is_alive():
                self.problem = self.problem or f"not written after {_PATIENCE_S:g} s"

    def __enter__(self) -> RunFolder:
        """Return itself."""
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        """Close."""
        self.close()

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            try:
                if not self.problem or self._events >= 0:
                    job()
            except OSError as error:
                self.problem = self.problem or f"{error.filename or self.path}: {error.strerror or error}"
            except Exception as error:  # a bug in here must not show in the run, only beside it
                self.problem = self.problem or f"{type(error).__name__}: {redact(str(error))}"
        if self._events >= 0:
            with contextlib.suppress(OSError):
                os.close(self._events)

    def _make(self) -> None:
        # whoever writes to it could put a link in the place of what is written next
        (believed if self.root == default_root() else private).make_folder(self.root)
        for twin in range(1, _MOST_TWINS):
            path = self.root / (self.name if twin == 1 else f"{self.name}-{twin}")
            with contextlib.suppress(FileExistsError):
                path.mkdir(mode=0o700)
                self.path = path
                break
        flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_EXCL
        self._events = os.open(self.path / "events.jsonl", flags, 0o600)

    def _append(self, line: str) -> None:
        data = line.encode("utf-8", "replace")
        if not self._cut and os.write(self._events, data) != len(data):
            self._cut = True
            raise OSError(28, "No space left on device", str(self.path / "events.jsonl"))
