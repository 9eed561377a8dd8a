"""A Compose project that is being converted, and the experiment that it becomes a part of.

Takes normal forms, and the folders of the files; gathers what is to be written. Looks at the file system,
reads nothing.
"""

from __future__ import annotations

import functools
import itertools
import os
import re
from collections.abc import Collection, Container, Mapping
from dataclasses import dataclass, field
from typing import Any

import msgspec

from srprov import names, own_records
from srprov.codes import Code
from srprov.conversion.notes import Notes
from srprov.conversion.subnets import Subnets
from srprov.definitions.paths import belongs
from srprov.errors import UsageError
from srprov.importing.compose.folders import innermost, led_away
from srprov.importing.compose.source import HINT
from srprov.importing.normal import Normal
from srprov.importing.position import Path

FILES = "files"
"""Folder of the experiment that what the files name is copied to."""
WRITTEN = "written"
"""Folder of what stood in the files themselves. None of it takes the place of what is copied, or the other way."""
_MOST_ALIKE = 1000
"""Names with a number behind them are tried one after the other."""


class Machine(msgspec.Struct, frozen=True):
    """One Compose project: the files that one machine runs."""

    normal: Normal
    folders: tuple[str, ...]
    """Real paths of the folders of its files, and of that of the whole project. Relative paths begin at the first."""
    robot: str = ""
    """The robot that it is pinned to."""


class Choices(msgspec.Struct, frozen=True):
    """What the user chose."""

    home: str = "robot"
    """The user of the robots whose home `~` is."""
    chosen_profiles: bool = False
    """Services were chosen by their profiles already."""
    own: Collection[str] = ()
    """Real paths of files of his own, which are not copied wherever they lie."""


@dataclass
class Making:
    """The experiment so far."""

    name: str
    choices: Choices = field(default_factory=Choices)
    network: dict[str, Any] = field(default_factory=dict)
    known: set[str] = field(default_factory=set)
    """Names that every hosts file of the experiment has: of services, on all machines, and their host names."""
    services: dict[str, dict[str, Any]] = field(default_factory=dict)
    volumes: dict[str, dict[str, str]] = field(default_factory=dict)
    """Named volumes that begin with a folder: name -> `seed`."""
    mounted: set[str] = field(default_factory=set)
    """Names of volumes that any project's services mount."""
    secrets: dict[str, dict[str, str]] = field(default_factory=dict)
    secret_names: dict[tuple[str, frozenset[tuple[str, str]]], str] = field(default_factory=dict)
    """What a secret would be called, and where its value is -> its name."""
    cdfs: dict[str, dict[str, Any]] = field(default_factory=dict)
    """CDF's file name -> what it says."""
    copies: dict[str, str] = field(default_factory=dict)
    """Path in the experiment -> the file or folder that is copied there."""
    texts: dict[str, str] = field(default_factory=dict)
    """Path in the experiment -> the text of a file that is written there."""
    withheld: set[str] = field(default_factory=set)
    """Real paths of files that hold secrets: they are never copied."""
    origins: dict[str, tuple[Notes, Path]] = field(default_factory=dict)
    """Service -> where it comes from."""
    words: dict[str, str] = field(default_factory=dict)
    """Robot -> what the folder of its files is called."""

    def word(self, robot: str) -> str:
        """Return what the folder of a robot's files is called: each has one of its own."""
        if robot not in self.words:
            self.words[robot] = self.free(_word(robot), "", self.words.values())
        return self.words[robot]

    def free(self, wanted: str, robot: str, *taken: Container[str]) -> str:
        """Return a name that nothing has yet: the wanted one, or one with the robot's or a number.

        Raises:
            UsageError: All of these are taken.
        """
        numbered = (f"{wanted}-{n}" for n in range(2, _MOST_ALIKE))
        for one in itertools.chain([wanted], [f"{wanted}-{_word(robot)}"] if robot else (), numbered):
            if not any(one in names_there for names_there in taken):
                return one
        words = f"more than {_MOST_ALIKE} things would be called '{wanted[:60]}' in the experiment"
        raise UsageError(words, hint="give them other names", code=Code.TOO_LARGE)


@dataclass
class Project:
    """One machine's project on its way."""

    machine: Machine
    making: Making
    document: Mapping[str, Any]
    notes: Notes
    names: dict[str, str] = field(default_factory=dict)
    """The service's name in Compose -> in the experiment."""
    volume_names: dict[str, str] = field(default_factory=dict)
    """The same of volumes."""

    @functools.cached_property
    def subnets(self) -> Subnets:
        """The subnets of the file's networks."""
        return Subnets.of(self.document.get("networks") or {})

    def path(self, written: str) -> str:
        """Return the absolute path of what is written relative to the project's folder."""
        return os.path.normpath(os.path.join(self.machine.folders[0], written))

    def elsewhere(self, source: str) -> str:
        """Return the hint for a path that `place` does not have."""
        if self._record(source):
            return "put a copy of what is meant into another folder, if whoever gets the experiment may have it"
        return HINT if self.notes.normal.home else "copy it there"

    def outside(self, source: str, at: Path) -> str:
        """Return what is said of a path that `place` does not have: where it leads, if not from beside its file."""
        if record := self._record(source):
            return f"lies in {record[-200:]}, srprov's own record, or what an export keeps secrets in: it is not copied"
        path, file = self.path(source), self.notes.normal.position_of(at).file
        beside = os.path.normpath(os.path.join(os.path.realpath(os.path.dirname(file)), source))
        is_moved = bool(self.notes.normal.home) and path != beside
        led = f"is {path[:200]}, as paths begin at the folder of the first file; that " if is_moved else ""
        return f"{led}lies outside of the folder of the file that says so"

    @property
    def base(self) -> str:
        """The folder that the paths of copies are relative to."""
        return os.path.commonpath(self.machine.folders)

    def place(self, source: str) -> str:
        """Return where a file or folder goes in the experiment that a file names.

        Empty when it lies outside of the folder of which the files may name others, or in what version control keeps
        there, such as tokens, or in a record: nobody knows again what lies there, once it is copied.
        """
        real = os.path.realpath(self.path(source))
        if not any(belongs(real, one) for one in self._folders) or led_away(self.path(source), self.machine.folders):
            return ""
        if self._record(source):
            return ""
        below = os.path.relpath(real, self.base)
        first = [FILES, *([self.making.word(self.machine.robot)] if self.machine.robot else [])]
        return os.path.normpath(os.path.join(*first, below))

    @property
    def _folders(self) -> tuple[str, ...]:
        """The folders of which the files may name what lies there; real paths."""
        return (self.notes.normal.home,) if self.notes.normal.home else self.machine.folders

    def _record(self, source: str) -> str:
        """Return the record in which a path lies, or which it is, below those folders; or nothing."""
        real = os.path.realpath(self.path(source))
        home = innermost(self._folders, real)
        return own_records.record_around(real, home) if home else ""

    def take(self, source: str) -> str:
        """Have a file or folder copied into the experiment, and return its path there; empty when it lies outside."""
        place = self.place(source)
        if place:
            self.making.copies[place] = os.path.realpath(self.path(source))
        return place


def service_name(written: str) -> str:
    """Return the name that a service of Compose has in an EDF; it may be taken."""
    short = re.sub(r"[^a-z0-9_-]", "-", written.lower())[:63].strip("-_")
    return short if names.valid("service", short) else f"service-{short}"[:63].strip("-_")


def instance_name(written: str) -> str:
    """Return the name of an experiment that is made of a project's."""
    return re.sub(r"[^a-z0-9-]+", "-", written.lower())[:32].strip("-") or "imported"


def _word(robot: str) -> str:
    return re.sub(r"[^a-z0-9-]+", "-", robot.lower())[:30].strip("-") or "robot"
