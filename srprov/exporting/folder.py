"""Write an export into a new folder: the only file of this room that touches the disk.

Files come before links, and everything lies below a folder that this made, and holds open: no link of the experiment's
leads a file elsewhere, nor one that others put in the folder's place. Modes are those of the experiment's files; the
folder itself is its owner's alone. What a repository elsewhere holds, or a plan of somebody's, makes none here.
"""

from __future__ import annotations

import os
import posixpath
import re
from collections.abc import Iterable

from srprov import believed
from srprov.codes import Code
from srprov.definitions.repository_names import WHY, repository_among
from srprov.errors import UsageError
from srprov.exporting.model import Export, File
from srprov.tree_links import leaving

_FOLDER = 0o755
_MARK = 0o700
_AS_IT_WAS = "files"
"""Where all lies as in the experiment's folder; elsewhere each folder came from a place of its own."""


def write_export(folder: str, made: Export) -> None:
    """Write an export into a folder, as `write` does.

    Raises:
        UsageError: As for `write`; or a link leads out of the part of the export in which it lies.
    """
    _check_links(made)
    write(folder, made.files)


def _check_links(made: Export) -> None:
    """Refuse a link out of `build/NAME/`, `files/` and so on: a folder is there to be copied, with what links lead to.

    So scp, zip and others do. From this place a stranger's link leads to another file than from where it was, also to
    one that another image is built from.
    """
    parts: dict[str, dict[str, str]] = {}
    for one in made.files:
        if one.link is not None:
            robot = next((each.folder for each in made.machines if one.path.startswith(each.folder)), "")
            names = one.path.removeprefix(robot).split("/")
            depth = 1 if names[0] == _AS_IT_WAS else min(2, len(names) - 1)
            parts.setdefault(f"{robot}{'/'.join(names[:depth])}", {})["/".join(names[depth:])] = one.link
    for part, links in sorted(parts.items()):
        try:
            path = leaving(links)
        except ValueError as error:
            raise UsageError(f"{part}: {error}", code=Code.OUTSIDE) from None
        if path:
            raise UsageError(
                f"the link {part}/{path} would lead out of {part}/: a copy of the export may have what it leads to",
                hint="put the file itself there, or leave the link out, of a build by .dockerignore",
                code=Code.OUTSIDE,
            )


def write(folder: str, files: Iterable[File]) -> None:
    """Write the files into a folder, which is made, or is there and empty.

    Raises:
        UsageError: It is not empty, cannot be written, or would hold a repository.
    """
    every = sorted(files, key=lambda one: (one.link is not None, not one.is_folder, one.path))
    if strange := repository_among(one.path for one in every):
        what = f"nothing is written: {strange[:200]}: {WHY}"
        hint = "leave it out of what the EDF ships, or of what the image is built from"
        raise UsageError(what, hint=hint, code=Code.STRANGE_FILE)
    try:
        os.makedirs(folder, mode=_MARK, exist_ok=True)
        with believed.to_fill(folder) as place:
            if os.listdir(place):
                raise UsageError(f"{folder} is not empty", hint="name a new folder with -o", code=Code.IN_THE_WAY)
            made = {""}
            for one in every:
                _write(place, one, made)
    except OSError as error:
        which = re.sub("/proc/self/fd/[0-9]+", lambda _: folder, str(error.filename or folder))
        raise UsageError(f"{which} cannot be written: {error.strerror}", code=Code.CANNOT_WRITE) from error


def _write(folder: str, one: File, made: set[str]) -> None:
    path = f"{folder}/{_checked(one.path)}"
    _make(folder, one.path if one.is_folder else posixpath.dirname(one.path), made)
    if one.link is not None:
        os.symlink(one.link, path)
    elif not one.is_folder:
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
        with os.fdopen(os.open(path, flags, 0o600), "wb") as file:
            file.write(one.content)
        os.chmod(path, one.mode)


def _make(folder: str, below: str, made: set[str]) -> None:
    """Make a folder and those above it but for `made`; they can be read by all, as what is mounted or built must be."""
    missing = list[str]()
    while below not in made:
        missing.append(below)
        below = posixpath.dirname(below)
    for one in reversed(missing):
        path = f"{folder}/{one}"
        os.mkdir(path)
        os.chmod(path, _FOLDER)
        made.add(one)


def _checked(path: str) -> str:
    """Return a path that stays below the folder.

    Raises:
        UsageError: It does not.
    """
    if path.startswith("/") or "" in path.split("/") or {".", ".."} & set(path.split("/")):
        raise UsageError(f"{path[:80]!r} is no path of an export", code=Code.NAME)
    return path
