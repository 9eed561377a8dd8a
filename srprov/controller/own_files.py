"""Files of the user's own that lie beside an EDF: with passwords of robots, their keys, files of secrets, and records.

Any file of the user's is one, too, by a second name that an archive gave it when it was unpacked there.

An inventory often lies there, and an EDF or a CDF of a stranger may ship the whole folder. Takes definitions and the
inventory; gives definitions that ask for each such file that would leave this machine, and for copies of the
inventory's. Keys and passwords of robots are known by what is in a file (`own_content`). A file that a secret was read
from stays one, whatever an EDF says by now. A record of srprov's own is asked for as a whole: it has a token by which
this machine knows a run, serial numbers and all that robots said. Reads what may be one of these, and tells nothing of
it; of a secret no byte, which may not be allowed yet.

What cannot be looked at is no reason to ask for less: what is looked through is just what would be shipped.
"""

from __future__ import annotations

import contextlib
import functools
import os
import stat
from collections.abc import Callable, Collection, Iterable, Iterator

from msgspec.structs import replace

from srprov import disk, regular_file, secret_files
from srprov.controller.permissions import permit_files, permit_planning
from srprov.definitions.containermodel import ContainerDefinition
from srprov.definitions.lockfile import lock_path
from srprov.definitions.model import Definitions, Inventory, Service
from srprov.definitions.own_content import LARGEST, is_own
from srprov.definitions.paths import inside
from srprov.definitions.taken import ANYBODY, in_words
from srprov.definitions.version_control import is_from_elsewhere, names_in
from srprov.git.cache import folders
from srprov.images.context import folder_items
from srprov.own_records import is_record, record_around
from srprov.planning.policy import permissions

COPIED_FIRST = ("git", "outside")
"""Kinds of permission without which nothing is copied: what is fetched, and files that are not the experiment's."""
NO_ROBOTS = Inventory(hosts={}, groups={})
"""Where nobody named any."""
_RECORD = "it is srprov's own record, or what it keeps secrets in"


def asked_for(definitions: Definitions, inventory: Inventory) -> Definitions:
    """Return definitions in which each such file that would be shipped counts as one outside of the folder."""
    experiment = definitions.experiment
    secrets = {one.file for one in experiment.secrets.values() if one.file} | secret_files.known()
    own = _Own({*inventory.own_files, *secrets}, inventory.own_files, os.path.realpath(experiment.folder))
    read = {*experiment.files, lock_path(experiment.file)}
    found = {(ANYBODY, one) for one in own.among(map(os.path.realpath, read))}
    for service in experiment.services.values():
        files = (experiment.secrets[use.source].file for use in service.secrets)
        found |= {(service.name, path) for path in files if path and has_names_elsewhere(path, own.folder)}
        cdf = definitions.containers.get(service.cdf)
        found |= {(service.name, path) for top in _tops(service, cdf) for path in own.below(top)}
        if cdf and cdf.dockerfile:
            context = cdf.context or os.path.dirname(cdf.dockerfile)
            found |= {(service.name, path) for path in (*own.in_context(context), *own.read(cdf.dockerfile))}
    outside = tuple(sorted({*experiment.outside, *((name, in_words(path)) for name, path in found)}))
    return replace(definitions, experiment=replace(experiment, outside=outside))


def permit_copies(definitions: Definitions, allowed: Collection[str], inventory: Inventory = NO_ROBOTS) -> None:
    """Refuse an export that copies what the user has not allowed.

    Raises:
        RefusedError: Names every permission that is missing.
    """
    found = asked_for(definitions, inventory)
    asked = permissions(found.experiment, found.containers)
    permit_planning([one for one in asked if one.kind in COPIED_FIRST], allowed)


def permit_compared(definitions: Definitions, allowed: Collection[str]) -> None:
    """Refuse to compare with a lock what the user has not allowed: what differs is told, and hashes can be guessed.

    A lock, and that it is to be compared, may be a stranger's words: the names of files, images and repositories that
    a file elsewhere says would be told, and whether a file's hash is the one there.

    Raises:
        RefusedError: Names every permission that is missing.
    """
    permit_files(asked_for(definitions, NO_ROBOTS), allowed)


def has_names_elsewhere(path: str, folder: str = "") -> bool:
    """Return whether a secret's file has a name that is not in the experiment's folder.

    Of one that lies elsewhere, or of an experiment that has no folder here, each further name counts: an archive is
    unpacked beside files of the user's, and both names are in one folder of his, then.
    """
    with contextlib.suppress(OSError, ValueError):  # it is told when it is read
        about = os.lstat(path)
        here = folder and inside(path, folder)
        return is_from_elsewhere(about, folder) if here else regular_file.has_further_names(about)
    return False


def _tops(service: Service, cdf: ContainerDefinition | None) -> set[str]:
    """Return the files and folders that a service or its CDF names; each is a path without links."""
    mounts = service.runtime.mounts
    found = {one.source for one in mounts if one.kind in ("tree", "data") and one.source}
    found |= {one.seed.path for one in mounts if one.seed}
    return found | ({one.source for one in cdf.files} if cdf else set())


class _Own:
    """The files, by their paths and some by what is in them: an import, or an editor, may have made a copy."""

    def __init__(self, paths: set[str], read: Collection[str], folder: str) -> None:
        """Take real paths, which of them may be read, and the experiment's folder."""
        self.paths = paths
        self._files = regular_file.identities(paths)
        self.folder, self._names = folder, functools.cache(names_in)
        self._contents: dict[int, set[bytes]] = {}
        for path in read:
            with contextlib.suppress(OSError):  # who needs it says so
                content = regular_file.read(path, LARGEST)
                self._contents.setdefault(len(content), set()).add(content)
        self._fetched = str(folders())
        is_one = functools.cache(is_record)
        self._record = functools.cache(lambda folder: self._record_around(folder, is_one))
        # many services may name one folder
        self.below, self.in_context = functools.cache(self._below), functools.cache(self._in_context)
        self.read = functools.cache(self._read)

    def has(self, path: str) -> bool:
        """Return whether a file is one, a copy of one, a private key, or has a password of robots."""
        if path in self.paths:
            return True
        with contextlib.suppress(OSError):
            about = os.lstat(path)
            known = (about.st_dev, about.st_ino)
            if known in self._files or is_from_elsewhere(about, self.folder, self._names):
                return True
            if stat.S_ISREG(about.st_mode) and 0 < (size := about.st_size) <= LARGEST:
                content = regular_file.read(path, size)
                return content in self._contents.get(size, ()) or is_own(content)
        return False

    def among(self, paths: Iterable[str]) -> Iterator[str]:
        """Yield those of some files that are one, or the record that a file lies in (`record_around`)."""
        for path in paths:
            if record := self._record(os.path.dirname(path)):
                yield f"{record}/: {_RECORD}"
            elif self.has(path):
                yield path

    def _record_around(self, folder: str, is_one: Callable[[str], bool]) -> str:
        """Return the record that a folder lies in, or nothing; what git fetched is somebody's who published it."""
        return "" if inside(folder, self._fetched) else record_around(folder, self.folder, is_one)

    def _below(self, top: str) -> tuple[str, ...]:
        """Return those that a file is, or that lie in a folder."""
        with contextlib.suppress(OSError):  # what cannot be looked through is not shipped, which says so
            return tuple(self.among(f"{top}/{one.path}".rstrip("/") for one in disk.shipped(top)))
        return ()

    def _in_context(self, folder: str) -> tuple[str, ...]:
        """Return those in a build's context, but for what its `.dockerignore` leaves out; and that one itself.

        It may leave itself out. What is in the image tells of its lines nevertheless, and so does what is said of them.
        """
        found = self.read(f"{folder}/.dockerignore")
        with contextlib.suppress(OSError, ValueError):  # it is told when the image is planned
            items = folder_items(folder, disk.listing, disk.read)
            found += tuple(self.among(f"{folder}/{one.path}" for one in items))
        return found

    def _read(self, path: str) -> tuple[str, ...]:
        """Return what is asked for of a file that a build reads, shipped or not; no link is followed."""
        is_file = os.path.isfile(path) and not os.path.islink(path)
        return tuple(self.among((path,))) if is_file else ()
