"""The files of a record -> Material: a run's folder, a run of trials, a bundle, a plan file.

Reads files, through `regular_file` and within limits; they may be anybody's. What is missing or is not what srprov
writes is named in `missing`, and the page is made of the rest.
"""

from __future__ import annotations

import hashlib
import io
import itertools
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol, TypeVar

import msgspec

from srprov import regular_file
from srprov.codes import Code
from srprov.errors import UsageError, visible
from srprov.report.material import EnvironmentView, FactsView, InputFile, Material
from srprov.report.model import AssignmentView, EventView, PlanView, ProbeView, ResultView

_T = TypeVar("_T")
MOST = 64 * regular_file.MIB
"""Bytes of one file of a record, and of all its inputs."""
MOST_PLAN = 256 * regular_file.MIB
"""Of a plan: one of a thousand robots has 150 MB, of which a page keeps a tenth."""
_MOST_VALUES = 16_000_000
"""Brackets and commas of a file: each value stands behind one. Colons do not count: a plan of many robots is full of
MAC addresses."""
_KEPT_EVENTS = frozenset({"start", "end", "waiting"})
_MOST_EVENTS = 250_000
"""Lines: a run of a thousand robots and 20,000 steps has a fifth of them."""
_MOST_BROKEN = 1000
_MOST_INPUTS = 200
_HINT = "name a run that `srprov runs` lists, a plan of `srprov plan -o`, or a bundle"


_ESCAPE = re.compile(
    rb"\\(?:u[dD][89abAB][0-9a-fA-F]{2}\\u[dD][c-fC-F][0-9a-fA-F]{2}|(u[dD][89a-fA-F][0-9a-fA-F]{2})|.)", re.DOTALL
)
"""Each escape of a JSON text; with a group where it is half of a surrogate pair: a path of bytes that are no UTF-8."""


class Unreadable(ValueError):
    """A file cannot be read; the message says why."""


class Source(Protocol):
    """Where the files of a record are."""

    def get(self, name: str, most: int) -> bytes | None:
        """Return a file's content; None where there is none; Unreadable where it cannot be had."""

    def names(self, folder: str) -> Iterator[str]:
        """Return the names of the files below a folder, whose name ends with `/`, in order; or Unreadable."""


class Folder(msgspec.Struct, frozen=True):
    """The files below a folder; a link among them is not followed, and one with a further name is not read.

    An archive may have made any file of the user's one of the folder, and a page is for others.
    """

    path: Path
    """Without a link in it."""

    def get(self, name: str, most: int) -> bytes | None:
        """Return a file's content, as Source has it."""
        try:
            content, about = regular_file.read_with_status(self.path / name, most, real=True)
        except FileNotFoundError:
            return None
        except OSError as error:
            raise Unreadable(error.strerror or str(error)) from None
        if regular_file.has_further_names(about):
            raise Unreadable("it has another name (a hard link); copy the record, if it is your own")
        return content

    def names(self, folder: str) -> Iterator[str]:
        """Return the names of files, as Source has it."""
        if (self.path / folder).is_symlink():  # whose target would be walked through, and told by its names
            raise Unreadable("it is a link")
        for place, folders, files in regular_file.walk(self.path / folder):
            folders.sort()
            for one in sorted(files):
                yield os.path.relpath(os.path.join(place, one), self.path)


class Reading:
    """Reads one file after another, and notes what is missing."""

    def __init__(self, source: Source, home: str = "") -> None:
        """Take where the files are, and the folder in there, which is empty or ends with `/`."""
        self.source, self.home = source, home
        self.missing: list[str] = []

    def bytes_of(self, name: str, most: int = MOST) -> bytes | None:
        """Return a file's content, or None."""
        try:
            return self.source.get(self.home + name, most)
        except Unreadable as error:
            self.missing.append(f"{name} cannot be read: {error}")
            return None

    def one(self, name: str, kind: type[_T], *, why: str = "", most: int = MOST) -> _T | None:
        """Return a file as a value of a type, or None; `why` says what a page lacks where there is no such file."""
        data = self.bytes_of(name, most)
        if data is None:
            self.missing += [f"there is no {name}: {why}"] if why else []
            return None
        try:
            return decoded(data, kind)
        except Unreadable as error:
            self.missing.append(f"{name} is not what srprov writes: {error}")
            return None

    def events(self) -> tuple[EventView, ...] | None:
        """Return the events of a run, without those that only show progress; None where there are none."""
        data = self.bytes_of("events.jsonl")
        if data is None:
            self.missing.append("there is no events.jsonl: nothing is known of when steps were done")
            return None
        found, broken = [], 0
        for count, line in enumerate(io.BytesIO(data)):  # not a list of all lines, of which there may be millions
            if count >= _MOST_EVENTS or broken >= _MOST_BROKEN:
                self.missing.append(f"events.jsonl is read up to its line {count}: it has too many, or is none")
                break
            try:
                event = decoded(line, EventView) if line.strip() else None
            except Unreadable:
                broken += 1  # the last line of a killed run may be torn
                continue
            if event is not None and event.event in _KEPT_EVENTS:
                found.append(event)
        if broken:
            self.missing.append(f"events.jsonl has {broken} lines that are no events")
        return tuple(found)

    def inputs(self) -> tuple[InputFile, ...]:
        """Return the files that the run was made of."""
        found: list[InputFile] = []
        left = MOST
        try:
            names = list(itertools.islice(self.source.names(f"{self.home}inputs/"), _MOST_INPUTS + 1))
        except Unreadable as error:
            self.missing.append(f"inputs cannot be read: {error}")
            return ()
        if len(names) > _MOST_INPUTS:
            self.missing.append(f"of its input files only {_MOST_INPUTS} are listed")
        for name in names[:_MOST_INPUTS]:
            data = self.bytes_of(name.removeprefix(self.home), left)
            if data is not None:
                left -= len(data)
                about = hashlib.sha256(data).hexdigest()
                found.append(InputFile(name=name.removeprefix(f"{self.home}inputs/"), size=len(data), sha256=about))
        return tuple(found)


def decoded(data: bytes, kind: type[_T]) -> _T:
    """Return JSON as a value of a type; what the type does not name is skipped.

    Raises:
        Unreadable: It is none.
    """
    if sum(map(data.count, (b"[", b"{", b","))) > _MOST_VALUES:
        raise Unreadable(f"it holds more than {_MOST_VALUES} values")
    try:
        try:
            return msgspec.json.decode(data, type=kind)
        except msgspec.ValidationError:
            raise
        except msgspec.DecodeError:
            return msgspec.json.decode(_ESCAPE.sub(_whole, data), type=kind)
    except (msgspec.DecodeError, RecursionError, UnicodeDecodeError) as error:
        raise Unreadable(visible(str(error) or "it is nested too deeply")[:200]) from None


def _whole(escape: re.Match[bytes]) -> bytes:
    """Return an escape of JSON as it is; half of a surrogate pair, which is no character, as the sign for none."""
    return b"\\ufffd" if escape[1] else escape[0]


def of_run(path: Path) -> Material:
    """Return what the record of an `apply` or its like holds.

    Raises:
        UsageError: It is no such record.
    """
    reading = Reading(Folder(Path(os.path.realpath(path))))
    about = reading.one("environment.json", EnvironmentView, why="who ran it with which versions is not known")
    ended = reading.bytes_of("result.json")
    result = reading.one("result.json", ResultView, why="the run was killed, or is under way")
    plan = reading.one("plan.json", PlanView, why="causes of steps are not known", most=MOST_PLAN)
    if about is None and result is None and plan is None:
        why = reading.missing[0]
        raise UsageError(f"{path} is no record of a run: {why}", hint=_HINT, code=Code.NO_RUN)
    return Material(
        kind="run",
        name=path.resolve().name,
        data_name="result.json" if ended is not None else "environment.json",
        data=ended if ended is not None else reading.bytes_of("environment.json") or b"{}",
        plan=plan,
        result=result,
        events=reading.events(),
        assignment=reading.one("assignment.json", AssignmentView),
        probe=reading.one("probe.json", ProbeView),
        facts=reading.one("facts.json", FactsView, why="nothing of the robots was recorded"),
        environment=about,
        inputs=reading.inputs(),
        missing=tuple(reading.missing),
    )


def of_plan(path: Path, data: bytes) -> Material:
    """Return what a plan file holds.

    Raises:
        UsageError: It is none.
    """
    try:
        plan = decoded(data, PlanView)
    except Unreadable as error:
        raise UsageError(f"{path} is no plan: {error}", hint=_HINT, code=Code.NO_PLAN) from None
    return Material(kind="plan", name=path.name, data_name="plan.json", data=msgspec.json.encode(plan), plan=plan)
