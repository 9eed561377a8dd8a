"""Copies between this machine and a container: what each word of the user means, and where the copy goes.

Takes a `ContainerFiles` of the robot; the rules are those of `cp`. What comes out is written by `copied_out.py`, what
goes in is read by `copied_in.py`.
"""

from __future__ import annotations

import os
import posixpath
import shlex
from collections.abc import Collection, Iterator

import msgspec

from srprov.codes import Code
from srprov.container_files import ContainerFiles, InContainer
from srprov.controller.copied import Copied
from srprov.controller.copied_in import Owner, tar_of
from srprov.controller.copied_out import Target, unpack
from srprov.controller.copied_raw import passed_on
from srprov.definitions.homes import homes_in
from srprov.definitions.model import VERSION_CONTROL_IN_ANY_CASE
from srprov.definitions.named_links import refuse_link
from srprov.definitions.paths import inside
from srprov.errors import UsageError
from srprov.regular_file import VARIABLES


class InService(msgspec.Struct, frozen=True, kw_only=True):
    """A path in a service's container, as a user names it."""

    service: str
    """A service, a replica, or SERVICE@ROBOT."""
    path: str
    """A whole path, without `.` and `..`."""
    content: bool = False
    """It ended with `/.`: the content of the folder is meant."""
    folder: bool = False
    """It ended with `/`: only a folder is meant."""


def place(word: str) -> InService | str:
    """Return what SOURCE or TARGET means: `SERVICE:/path`, else a path here, as `./a:b` is.

    Raises:
        UsageError: It names a service, and no whole path; or a link, which a project may have brought.
    """
    service, colon, path = word.partition(":")
    if not colon or "/" in service or service.startswith((".", "~")):
        return _here(word)
    if not service or not path.startswith("/"):
        hint = f"a path in a container begins with /; a file here that is called so is ./{word}"
        raise UsageError(f"'{word}' is no SERVICE:/path", hint=hint, code=Code.OPTION_VALUE)
    content = path.endswith(("/.", "/./"))
    return InService(
        service=service, path=_whole(path), content=content, folder=content or path.endswith("/")
    )  # fmt: skip


def _here(path: str) -> str:
    """Refuse a link: a stranger's may lead a copy to a key of the user's, or into his folders."""
    if path != "-":
        refuse_link(path)
    return path


def _whole(path: str) -> str:
    return "/" + posixpath.normpath(path).lstrip("/")


def copy_out(
    files: ContainerFiles, container: str, source: InService, target: str, copied: Copied, *, preserve: bool,
    believed: Collection[str] = (),
) -> None:  # fmt: skip
    """Copy a file or folder from a container to this machine.

    Args:
        files: The robot's containers.
        container: Which one.
        source: What is copied.
        target: Where it goes, as the user says it.
        copied: Is told what was done.
        preserve: Keep permissions and times.
        believed: Files that this very command goes by: the inventory, the EDF, and what that is made from.

    Raises:
        UsageError: It is not there, or the target cannot take it.
        TransportError: The engine refuses, or it or the robot is gone.
        OSError: Something cannot be written.
    """
    path, found = _found(files, container, source)
    place_here = _target(source, found, target)
    _refuse_beside_own(place_here, believed)
    unpack(files.copy_out(container, path), place_here, copied, preserve=preserve)


def _refuse_beside_own(target: Target, believed: Collection[str]) -> None:
    """Refuse a folder in which names that a container chooses would lie among what the user's programs go by.

    Variables beside an inventory name programs, and so do settings in the folder in which somebody works, and in a
    home. CDFs say what runs, also on other robots, and secrets' files what only these should know. So it is with what
    is added to these variables, to a folder of inventories, or to what version control keeps.
    Whether a folder or a file comes is the engine's word, so it does not count here.

    Raises:
        UsageError: So it is.
    """
    folder = os.path.join(target.folder, target.name)
    held = {one: "a home" for one in homes_in(folder)} | {os.curdir: "where you work"}
    for one in believed:  # by its name, and where links lead
        held |= {one: one, os.path.dirname(one) or os.curdir: one}
    why = next((why for one, why in held.items() if inside(one, folder)), "")
    why = why or next((one for one in _read_whole(believed) if inside(folder, one)), "")
    if why := why or _repository_around(folder):
        raise UsageError(
            f"{folder} is, holds or lies in {why}: what a container has could name programs there",
            hint="copy it into a folder of its own",
            code=Code.IN_THE_WAY,
        )


def _read_whole(believed: Collection[str]) -> Iterator[str]:
    """Yield the folders of which all is read with such files, whether they are there or not."""
    for one in believed:
        if os.path.isdir(one):
            yield one
        yield from (os.path.join(os.path.dirname(one), name) for name in VARIABLES)


def _repository_around(path: str) -> str:
    """Return the name by which a path is in what version control keeps; what lies above where one works is no matter.

    Somebody has a folder of his own that is called `CVS`, and works below it.
    """
    real, here = os.path.realpath(path), os.path.realpath(os.curdir)
    below = os.path.relpath(real, here) if inside(real, here) else real
    return next((one for one in below.split(os.sep) if one.casefold() in VERSION_CONTROL_IN_ANY_CASE), "")


def raw_out(files: ContainerFiles, container: str, source: InService, copied: Copied) -> Iterator[bytes]:
    """Return a file or folder of a container as a tar, under the name that the user copies, but for devices.

    Raises:
        UsageError: It is not there.
        TransportError: The engine refuses, or it or the robot is gone.
    """
    path, _ = _found(files, container, source)
    return passed_on(files.copy_out(container, path), posixpath.basename(source.path), copied)


def copy_into(
    files: ContainerFiles, container: str, source: str, target: InService, owner: Owner, copied: Copied
) -> None:
    """Copy a file or folder from this machine into a container.

    Raises:
        UsageError: It is not there, cannot be read, or the target cannot take it.
        TransportError: The engine refuses, or it or the robot is gone.
    """
    if not os.path.exists(source):
        raise UsageError(f"{source}: there is no such file or folder", code=Code.NO_FILE)
    content = source.endswith("/.") or source == "."
    folder, name = _place_there(files, container, target, source, content)
    files.copy_into(container, folder, tar_of(source, name, owner, copied))


def raw_into(files: ContainerFiles, container: str, tar: Iterator[bytes], target: InService) -> None:
    """Unpack a tar of the user's in a folder of a container.

    Raises:
        UsageError: There is no such folder.
        TransportError: The engine refuses, or it or the robot is gone.
    """
    path, found = _found(files, container, target)
    if not found.is_folder:
        raise UsageError(f"{target.service}:{path} is no folder", hint="a tar is unpacked in one", code=Code.NO_FILE)
    files.copy_into(container, path, tar)


def _found(files: ContainerFiles, container: str, what: InService) -> tuple[str, InContainer]:
    """Return what is at a path, and where it really lies: one link is followed."""
    path, found = what.path, files.path_in(container, what.path)
    if found is not None and found.link:
        path = _whole(found.link)
        found = files.path_in(container, path)
    if found is None:
        raise UsageError(f"there is no {what.path} in {what.service}", code=Code.NO_FILE)
    if not (found.is_folder or found.is_file):
        raise UsageError(f"{what.service}:{what.path} is neither a file nor a folder", code=Code.NO_FILE)
    if what.folder and not found.is_folder:
        raise UsageError(f"{what.service}:{what.path} is no folder", code=Code.NO_FILE)
    return path, found


def _target(source: InService, found: InContainer, target: str) -> Target:
    """Return where a copy of what was found goes here."""
    name = "" if source.content else posixpath.basename(source.path)
    if os.path.isdir(target):
        return Target(folder=target, name=name)
    if os.path.lexists(target) and found.is_folder:
        raise UsageError(
            f"{target}: a file is there, and {source.service}:{source.path} is a folder", code=Code.IN_THE_WAY
        )
    if target.endswith("/") and not found.is_folder:
        raise UsageError(f"{target}: there is no such folder", code=Code.NO_FILE)
    above, name = os.path.split(target.rstrip("/"))
    if not os.path.isdir(above or "."):
        raise UsageError(f"{above}: there is no such folder", hint=f"mkdir -p {shlex.quote(above)}", code=Code.NO_FILE)
    return Target(folder=above or ".", name=name)


def _place_there(
    files: ContainerFiles, container: str, target: InService, source: str, content: bool
) -> tuple[str, str]:
    """Return the folder of the container into which a tar goes, and what the copy is called in it."""
    path, there = target.path, files.path_in(container, target.path)
    if there is not None and there.link:
        path = _whole(there.link)
        there = files.path_in(container, path)
    where = f"{target.service}:{target.path}"
    if there is not None and there.is_folder:
        return path, "" if content else os.path.basename(os.path.abspath(source))
    folder = os.path.isdir(source)
    if there is not None and folder:
        raise UsageError(f"{where} is a file, and {source} is a folder", code=Code.IN_THE_WAY)
    if target.folder and not (folder and there is None):
        raise UsageError(f"there is no folder {where}", code=Code.NO_FILE)
    above = posixpath.dirname(path)
    found = files.path_in(container, above)
    if found is None or not (found.is_folder or found.link):
        raise UsageError(f"there is no folder {target.service}:{above}", code=Code.NO_FILE)
    return above, posixpath.basename(path)
