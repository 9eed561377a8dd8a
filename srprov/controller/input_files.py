"""What an experiment was read from, for records: its definitions with all that they name, and what is shipped.

Takes a `Planned`; gives contents by path. Definitions are those that were read; what is shipped is read again, and
compared with what was shipped by then, so that a record never holds another content than the robots got.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
from collections.abc import Iterator, Mapping

import msgspec

from srprov import datasets, plain_tar, regular_file
from srprov.codes import Code
from srprov.controller.plan import Planned
from srprov.definitions.containermodel import ContainerDefinition
from srprov.definitions.lockfile import lock_path
from srprov.errors import UsageError

_LARGEST = 8 * regular_file.MIB
"""Of a definition file: what it may have as one."""
_LARGEST_TEXT = regular_file.MIB
FOR_READERS = ("LICENSE", "LICENSE.txt", "LICENSE.md", "COPYING", "CITATION.cff")
"""Names of files that say what may be done with an experiment, and how it is cited."""
_CHANGED = "it was changed after it was planned: run the command again"


class InputFile(msgspec.Struct, frozen=True, kw_only=True):
    """One file of an experiment."""

    content: bytes = b""
    executable: bool = False
    link: str | None = None
    """Where a symbolic link points to; it has no content."""
    data: tuple[str, int] | None = None
    """sha256 and size of a data set, whose content is not kept: it may be large."""
    for_readers: bool = False
    """Nothing that is run follows from it."""


def reader_files(planned: Planned) -> dict[str, InputFile]:
    """Return what lies beside the EDF for whoever gets the experiment: its license, and how it is cited.

    The EDF names none of them, so nobody is asked: a link may lead to any file of the controller, and a file with more
    names may be one of the user's, to which an archive gave this one. Neither is any of them.
    """
    found: dict[str, InputFile] = {}
    if planned.definitions is None:
        return found
    home = planned.definitions.experiment.home
    for name in FOR_READERS:
        try:
            content, about = regular_file.read_with_status(os.path.join(home, name), _LARGEST_TEXT, real=True)
            if not regular_file.has_further_names(about):
                found[name] = InputFile(content=content, for_readers=True)
        except OSError:  # most experiments have none of them
            continue
    return found


def definition_files(planned: Planned) -> dict[str, InputFile]:
    """Return the EDF, its lock, CDFs with those that they extend, env_files and playbooks; a plan file has none.

    Keys are paths relative to the EDF's folder. But for the lock, all is as it was read for the plan: since then others
    may have put a link to any file of the controller there, or above it.
    """
    if planned.definitions is None:
        return {}
    experiment, containers = planned.definitions.experiment, planned.definitions.containers
    known = {experiment.file: experiment.text, **{path: one.text for path, one in containers.items()}}
    known |= {one.file: one.text for one in planned.playbooks}
    known |= {one.dockerfile: one.dockerfile_text for one in containers.values() if one.dockerfile}
    found = {path: InputFile(content=content) for path, content in experiment.contents.items()}
    found |= {path: InputFile(content=text.encode("utf-8", "surrogateescape")) for path, text in known.items()}
    lock = lock_path(experiment.file)
    with contextlib.suppress(OSError):  # it need not be there
        place = os.path.join(experiment.home, os.path.basename(lock))
        found[lock] = InputFile(content=regular_file.read(place, _LARGEST, real=True))
    return {os.path.relpath(path, experiment.folder): one for path, one in sorted(found.items())}


def shipped_files(planned: Planned) -> dict[str, InputFile]:
    """Return what services mount, seeds and data sets too, and what images are built with, by paths as above.

    Raises:
        UsageError: One cannot be read, or is not any more what was planned.
    """
    if planned.definitions is None or planned.experiment is None:
        return {}
    from srprov import disk

    folder = planned.definitions.experiment.folder
    sent = set(_sent(planned))
    found: dict[str, InputFile] = {}
    path = ""
    try:
        for path in _data_sets(planned):
            found[os.path.relpath(path, folder)] = InputFile(data=datasets.digest(path))
        with disk.together():
            for path, one in _listed(planned):
                content = b"" if one.link is not None else disk.read(path)
                compared = one.sent and one.link is None and os.path.basename(path) != "Dockerfile"
                if compared and _hash(content) not in sent:
                    raise UsageError(f"{path} cannot be recorded: {_CHANGED}", code=Code.NO_FILE)
                found[os.path.relpath(path, folder)] = InputFile(
                    content=content, executable=one.executable, link=one.link
                )
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise UsageError(f"{path or folder} cannot be recorded: {why}", hint=_CHANGED, code=Code.NO_FILE) from error
    return found


def texts(files: Mapping[str, InputFile]) -> dict[str, str]:
    """Return the contents as text, by their paths."""
    return {path: one.content.decode("utf-8", "replace") for path, one in files.items()}


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _sent(planned: Planned) -> Iterator[str]:
    """Return the sha256 of every file that robots get in a tree or in a build context."""
    trees = [one.params.blob for one in planned.desired if one.module in ("tree", "volume") and one.params.blob]
    for tar in (*trees, *(image.context for image in planned.images.values())):
        yield from (_hash(one.content) for one in plain_tar.members(tar) if one.content is not None)


class _Listed(msgspec.Struct, frozen=True):
    executable: bool
    link: str | None
    sent: bool
    """To a robot; else it is of an image that a bundle has, and nothing was built with it."""


def _listed(planned: Planned) -> Iterator[tuple[str, _Listed]]:
    """Return absolute path -> what is shipped."""
    from srprov import disk

    assert planned.experiment is not None and planned.definitions is not None  # the caller looked
    every = [mount for one in planned.experiment.services.values() for mount in one.runtime.mounts]
    mounts = {mount.source for mount in every if mount.kind == "tree"} | {one.seed.path for one in every if one.seed}
    containers = planned.definitions.containers
    sent = mounts | {file.source for one in _built(planned) for file in one.files}
    sources = {file.source for one in containers.values() for file in one.files if not one.image}
    for source in sorted(mounts | sources):
        for item in disk.shipped(source):
            listed = _Listed(item.executable, item.link, source in sent)
            yield os.path.join(source, item.path).rstrip("/"), listed
    contexts = {_context(one) for one in _built(planned) if one.dockerfile}
    for folder in sorted({_context(one) for one in containers.values() if one.dockerfile}):
        from srprov.images.context import folder_items

        for item in folder_items(folder, disk.listing, disk.read):
            yield os.path.join(folder, item.path), _Listed(item.executable, item.link, folder in contexts)


def _built(planned: Planned) -> Iterator[ContainerDefinition]:
    """Return the CDFs of which an image was planned."""
    assert planned.definitions is not None  # the caller looked
    for key, one in planned.definitions.containers.items():
        if not one.image and key not in planned.unbuilt:
            yield one


def _data_sets(planned: Planned) -> list[str]:
    assert planned.experiment is not None  # the caller looked
    every = (mount for one in planned.experiment.services.values() for mount in one.runtime.mounts)
    return sorted({mount.source for mount in every if mount.kind == "data" and mount.source})


def _context(one: ContainerDefinition) -> str:
    return one.context or os.path.dirname(one.dockerfile)


def listing(files: Mapping[str, InputFile], places: Mapping[str, str], kept: Mapping[str, bytes]) -> list[object]:
    """Return a record's list of its input files.

    Args:
        files: By their paths, relative to the EDF's folder.
        places: Path -> where in the record it is.
        kept: Path -> its content there, without secrets.
    """
    return [
        {
            "path": path,
            **_told(one, places[path], kept.get(path, b"")),
            **({"executable": True} if one.executable else {}),
            **({"for_readers": True} if one.for_readers else {}),
            **({"redacted": True} if path in kept and kept[path] != one.content else {}),
        }
        for path, one in sorted(files.items())
    ]


def _told(one: InputFile, place: str, kept: bytes) -> dict[str, object]:
    if one.data is not None:
        return {"data": place, "sha256": one.data[0], "size": one.data[1]}
    return {"link": one.link} if one.link is not None else {"file": place, "sha256": _hash(kept)}
