"""A draft -> a folder with an experiment that validates, or nothing at all.

Takes a draft and the folder's name. Writes into a folder beside it first, or in it when it is there, checks what was
written as `validate` does, and then puts it in its place; problems are told at the lines of the files that they come
from.
"""

from __future__ import annotations

import errno
import functools
import os
import secrets
import stat
from collections.abc import Collection, Sequence

from msgspec.structs import replace

from srprov import __version__, believed, own_records, regular_file, trees
from srprov.codes import Code
from srprov.conversion.experiment import Draft
from srprov.conversion.report import as_markdown
from srprov.conversion.tree import Tree
from srprov.conversion.withheld import is_withheld
from srprov.definitions import check_files
from srprov.definitions.model import VERSION_CONTROL
from srprov.definitions.repository_names import WHY, repository_among
from srprov.definitions.version_control import ELSEWHERE, is_from_elsewhere, names_in
from srprov.errors import Diagnostic, UsageError
from srprov.importing.normal import Refused
from srprov.tree_links import leaving
from srprov.yamldoc import writer

EDF = "experiment.edf"
REPORT = "import-report.md"
_MOST_BYTES = 96 * regular_file.MIB
_MOST_ENTRIES = 20_000
_DEEPEST = 50
"""Folders in each other that are copied."""


def check_target(folder: str) -> None:
    """Check that a folder is new or empty.

    Raises:
        UsageError: It is not.
    """
    try:
        entries = os.listdir(folder)
    except FileNotFoundError:
        if not os.path.isdir(os.path.dirname(os.path.abspath(folder))):
            raise UsageError(f"there is no folder for {folder}", hint="make it first", code=Code.CANNOT_WRITE) from None
        return
    except OSError as error:
        raise UsageError(f"cannot write to {folder}: {error.strerror}", code=Code.CANNOT_WRITE) from None
    if entries:
        raise UsageError(
            f"{folder} holds files already", hint="name a folder that is new or empty", code=Code.IN_THE_WAY
        )


def write(draft: Draft, folder: str, files: Sequence[str]) -> None:
    """Write an experiment into a new or empty folder.

    Raises:
        Refused: What was made does not validate, or a file cannot be copied; nothing is left.
        UsageError: The folder cannot be written.
    """
    check_target(folder)
    absolute, name = os.path.abspath(folder), f"{secrets.token_hex(4)}.part"
    inside = os.path.isdir(absolute)
    beside = os.path.join(absolute, name) if inside else f"{absolute}.{name}"
    try:
        os.mkdir(beside, 0o700)
        with believed.to_fill(beside) as place:
            _fill(draft, place, (os.path.realpath(folder), beside), files)
            if problems := check_files([os.path.join(place, EDF)], ("*",) if _has_profiles(draft) else ()):
                raise Refused([_at_home(one, draft, place) for one in problems])
            if inside:
                with believed.to_fill(absolute) as home:
                    for entry in sorted(os.listdir(place)):
                        os.rename(os.path.join(place, entry), os.path.join(home, entry))
            else:
                os.rename(beside, absolute)
    except OSError as error:
        raise UsageError(
            f"cannot write {error.filename or folder}: {error.strerror}", code=Code.CANNOT_WRITE
        ) from error
    finally:
        trees.remove(beside)


def _has_profiles(draft: Draft) -> bool:
    return any("profiles" in one for one in draft.edf["services"].values())


def _fill(draft: Draft, place: str, passed_over: tuple[str, ...], files: Sequence[str]) -> None:
    tree = Tree(place)
    folders = {draft.home} if draft.home else {os.path.dirname(os.path.realpath(one)) for one in files}
    copying = _Copying(tree, draft, passed_over, folders)
    for below, source in sorted(draft.copies.items()):
        try:
            copying.take(source, below)
        except OSError as error:
            which = error.filename or source
            hint = "leave it out, or make it an image's; of a hard link make a copy"
            raise UsageError(f"cannot copy {which}: {error.strerror}", hint=hint, code=Code.NO_FILE) from error
    copying.check_links()
    for below, text in draft.texts.items():
        tree.write(below, text.encode("utf-8", "replace"))
    names = ", ".join(os.path.basename(one) for one in files)
    about = f"Made from {names} by srprov import {__version__}; {REPORT} says how."
    written = {name: writer.document(one, about) for name, one in (*draft.cdfs.items(), (EDF, draft.edf))}
    for name, text in {**written, REPORT: as_markdown(draft, files)}.items():
        tree.write(name, text.encode("utf-8", "replace"), 0o600)
    if strange := repository_among(tree.places):  # where it was cloned, `.git` comes before it
        hint = "leave it out of what the files mount, or build from"
        raise UsageError(f"nothing is written: {strange[:200]}: {WHY}", hint=hint, code=Code.STRANGE_FILE)
    tree.finish()


class _Copying:
    """Copies files and folders with their modes, within limits; links stay links."""

    def __init__(self, tree: Tree, draft: Draft, passed_over: tuple[str, ...], folders: Collection[str]) -> None:
        self.tree = tree
        self.withheld = draft.withheld
        self.known = regular_file.identities(draft.withheld)
        self.passed_over = passed_over
        self.folders = folders
        """Of the files that are imported, or of their whole project."""
        self.names = functools.cache(names_in)
        self.links: dict[str, str] = {}
        self.homes: dict[str, str] = {}
        """Where a folder of the files is in the tree -> a link that lies in it, as it is called here."""
        self.bytes = 0
        self.entries = 0
        """Files, folders and links."""

    def take(self, source: str, place: str) -> None:
        """Copy a file, or a folder with all below it but for records, to its place in the tree.

        Raises:
            OSError: It cannot be read, or is too much.
        """
        if is_withheld(source, self.withheld):  # a secret is in it, or in a folder that holds it
            return
        if os.path.isdir(source):
            if source not in self.folders and own_records.is_record(source):
                return  # a project can call its marks secrets, and what is known by them were copied without
            if place.count("/") > _DEEPEST:
                raise OSError(errno.ELOOP, f"more than {_DEEPEST} folders lie in each other", source)
            self._count()
            self.tree.make(place)
            for entry in sorted(os.listdir(source)):
                inner = os.path.join(source, entry)
                if entry not in VERSION_CONTROL and inner not in self.passed_over:
                    self._entry(inner, f"{place}/{entry}")
        else:
            self._file(source, place)

    def _entry(self, source: str, place: str) -> None:
        about = os.lstat(source)
        if stat.S_ISLNK(about.st_mode):
            self._count()
            self._check_own(source, about)
            self.links[place] = os.readlink(source)
            above = os.path.dirname(source)
            home = os.path.relpath(self._own_folder(source), above)
            self.homes.setdefault(os.path.normpath(os.path.join(os.path.dirname(place), home)), source)
            self.tree.link(place, self.links[place])
        else:
            self.take(source, place)

    def _count(self) -> None:
        """Count what would be made, before it is; raises OSError when it is too much."""
        self.entries += 1
        if self.entries > _MOST_ENTRIES:
            raise OSError(0, f"more than {_MOST_ENTRIES} files, folders and links would be copied")

    def check_links(self) -> None:
        """Refuse a link out of the innermost folder of a file, where there are several: to what another one names.

        No container goes that way, but who copies what is written by scp or zip has the file there, and ships it.

        Raises:
            UsageError: There is one.
        """
        for home, known in sorted(self.homes.items()) if len(self.folders) > 1 else ():
            top = f"{home}/"
            below = {place.removeprefix(top): one for place, one in self.links.items() if place.startswith(top)}
            try:
                out = leaving(below)
            except ValueError as error:
                raise UsageError(f"nothing is written: {known}: {error}", code=Code.OUTSIDE) from None
            if out:
                words = f"the link {top}{out} leads out of the folder of the file that has it copied"
                hint = "copy what it leads to there"
                raise UsageError(f"nothing is written: {words}", hint=hint, code=Code.OUTSIDE)

    def _file(self, source: str, place: str) -> None:
        self._count()
        content, about = regular_file.read_with_status(source, _MOST_BYTES, real=True)
        known = (about.st_dev, about.st_ino)
        if known in self.known:  # the same file as one that is never copied
            return
        self._check_own(source, about)
        self.bytes += len(content)
        if self.bytes > _MOST_BYTES:
            raise OSError(0, f"more than {_MOST_BYTES // regular_file.MIB} MiB would be copied")
        self.tree.write(place, content, stat.S_IMODE(about.st_mode) & 0o777)

    def _check_own(self, source: str, about: os.stat_result) -> None:
        """Refuse a file or a link that is from elsewhere: once it is copied, nobody knows it again."""
        if regular_file.has_further_names(about) and is_from_elsewhere(about, self._own_folder(source), self.names):
            raise OSError(errno.EXDEV, ELSEWHERE, source)

    def _own_folder(self, source: str) -> str:
        """Return the innermost folder around a file: further up lie the files of whoever laid another one over it."""
        around = (one for one in self.folders if source.startswith(f"{one.rstrip('/')}/"))
        return max(around, key=len, default=os.path.dirname(source))


def _at_home(problem: Diagnostic, draft: Draft, beside: str) -> Diagnostic:
    """Return a problem of what was written as one of what it was made from."""
    file = os.path.relpath(problem.location.file, beside)
    for place, source in sorted(draft.copies.items(), reverse=True):
        if file == place or file.startswith(f"{place}/"):
            where = os.path.normpath(os.path.join(source, os.path.relpath(file, place)))
            return replace(problem, location=replace(problem.location, file=where))
    built = next((name for name, one in draft.edf["services"].items() if one.get("cdf") == file), "")
    parts = problem.path.split(".")
    key: tuple[str, ...]
    name, key = built, ("build",)
    if not built and len(parts) > 1:
        name, key = (_user(parts[1], draft), ("volumes",)) if parts[0] == "volumes" else (parts[1], tuple(parts[2:3]))
    notes, at = draft.origins.get(name) or next(iter(draft.origins.values()))
    path = (*at, *key) if name in draft.origins else ()
    hint = f"{problem.hint}; " if problem.hint else ""
    shown = ".".join(map(str, path))
    source_at, hint = notes.normal.position_of(path), f"{hint}of what it became here"
    return Diagnostic(source_at, problem.message, shown, "", hint, code=problem.code)


def _user(volume: str, draft: Draft) -> str:
    """Return the first service that mounts a named volume."""
    services = draft.edf["services"].items()
    mounts = ((name, one) for name, entry in services for one in entry.get("volumes", ()))
    return next((name for name, one in mounts if str(one).startswith(f"{volume}:")), "")
