"""What the lab remembers between two commands: small JSON files in /run.

A process is named by its id and its start time, so an id that the machine has given to somebody
else since is never mistaken for ours. Files are replaced, never written in place: a killed run
leaves the old one or the new one.
"""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec

from srprov.lab.places import Site


class Process(msgspec.Struct, frozen=True):
    """A process of this machine that cannot be mistaken for a later one with the same id."""

    pid: int
    started: int

    @classmethod
    def of(cls, pid: int) -> Process | None:
        """The living process with this id; a zombie counts as dead."""
        try:
            stat = Path(f"/proc/{pid}/stat").read_text()
        except OSError:
            return None
        fields = stat.rpartition(")")[2].split()  # the name before it may hold blanks and brackets
        return None if fields[0] in "ZX" else cls(pid, int(fields[19]))

    @property
    def alive(self) -> bool:
        """Whether this very process still runs."""
        return Process.of(self.pid) == self


class Booted(msgspec.Struct, frozen=True):
    """A robot that was booted: its PID 1, and the digest of the options that it was booted with."""

    init: Process
    options: str


class Lab(msgspec.Struct, frozen=True):
    """The lab as the last `up` wanted it."""

    spec: dict[str, Any]
    user: str | None
    since: str
    """When it was first brought up, in UTC."""
    inventories: tuple[str, ...] = ()
    written: str = ""
    """What `written.digest` says of what stands in each of them; empty of a lab that an older srprov brought up."""


def read_lab(site: Site) -> Lab | None:
    """The lab that is up, or was when the machine's run was killed; of a later srprov's, what is known here."""
    found = read(site.run / "lab.json")
    return None if found is None else msgspec.convert(found, Lab)


def write_lab(site: Site, lab: Lab) -> None:
    """Remember what `up` wanted."""
    write(site.run / "lab.json", msgspec.to_builtins(lab))


def read_robot(site: Site, name: str) -> Booted | None:
    """The robot's last boot, if its PID 1 is still alive."""
    found = read(site.run / "robots" / f"{name}.json")
    if found is None:
        return None
    booted = Booted(Process(**found["init"]), found["options"])
    return booted if booted.init.alive else None


def write_robot(site: Site, name: str, booted: Booted) -> None:
    """Remember a boot; to be done before the robot is told to go."""
    write(site.run / "robots" / f"{name}.json", msgspec.to_builtins(booted))


def forget_robot(site: Site, name: str) -> None:
    """The robot was killed, or has left the lab."""
    (site.run / "robots" / f"{name}.json").unlink(missing_ok=True)


def read(path: Path) -> dict[str, Any] | None:
    """Return what was written; None if nothing was."""
    try:
        found = json.loads(path.read_text())
    except FileNotFoundError:
        return None
    assert isinstance(found, dict)
    return found


def write(path: Path, value: dict[str, Any]) -> None:
    """Put a JSON file in the place of the one before."""
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_suffix(".new")
    draft.write_text(json.dumps(value, indent=1, sort_keys=True) + "\n")
    draft.replace(path)


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """One command at a time may change what the folder is about; the others wait."""
    while True:
        lock = _lock_file(folder)
        if lock is None:
            continue
        try:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if _same_file(lock, folder / "lock"):  # `lab down` may have removed it while we waited
                yield
                return
        finally:
            os.close(lock)


def _lock_file(folder: Path) -> int | None:
    """Open the folder's lock file; None if `lab down` removed the folder at that very moment."""
    try:
        folder.mkdir(mode=0o755, parents=True, exist_ok=True)
        return os.open(folder / "lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    except FileNotFoundError:
        return None


def _same_file(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except FileNotFoundError:
        return False
