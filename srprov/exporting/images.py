"""The folders that Compose builds images from: a Dockerfile with its build context, one folder per CDF. Pure.

Takes CDFs and functions that read the controller's files; gives files and Compose's `build`. What is built is what
srprov builds, but for its label and the marks of its builds.
"""

from __future__ import annotations

import itertools
import posixpath
from collections.abc import Collection, Mapping
from typing import Any

import msgspec

from srprov.definitions.containermodel import ContainerDefinition
from srprov.exporting.model import File
from srprov.exporting.variables import Open
from srprov.images.args import with_digests
from srprov.images.context import DOCKERFILE, Listing, Read, folder_entries
from srprov.images.dockerfile import FieldErrors
from srprov.images.plan import ContextFile
from srprov.images.tag import Checkouts, generated, repository_of


class Built(msgspec.Struct, frozen=True, kw_only=True):
    """One image to be built."""

    name: str
    """Of its folder."""
    files: tuple[File, ...]
    """With paths below that folder."""
    build: Mapping[str, Any]
    """Compose's `build`, but for the context's path."""
    moving: tuple[str, ...] = ()
    """Of its code repositories, in words, which commit they are now."""


def built(
    containers: Mapping[str, ContainerDefinition], listing: Listing, read: Read, checkout: Checkouts, open_: Open
) -> dict[str, Built]:
    """Return CDF's key -> its folder, for those that are built.

    Raises:
        DefinitionError: Fields that cannot become an image, files that cannot be read; all of one CDF, at their lines.
    """
    found: dict[str, Built] = {}
    names: set[str] = set()
    for key, cdf in sorted(containers.items()):
        if cdf.image:
            continue
        name = _free(repository_of(cdf).partition("/")[2], names)
        names.add(name)
        if cdf.dockerfile:
            found[key] = _from_folder(cdf, name, listing, read)
        else:
            found[key] = _from_base(cdf, name, listing, read, checkout, open_)
    return found


def _free(wanted: str, taken: Collection[str]) -> str:
    numbered = (f"{wanted}-{number}" for number in itertools.count(2))
    return next(name for name in itertools.chain((wanted,), numbered) if name not in taken)


def _from_base(
    cdf: ContainerDefinition, name: str, listing: Listing, read: Read, checkout: Checkouts, open_: Open
) -> Built:
    dockerfile, entries, moving = generated(cdf, listing, read, checkout)
    lines = dockerfile.text.rstrip("\n").split("\n")[:-1]  # the last says that srprov built it
    text, variables = open_.as_args("\n".join(lines) + "\n")
    args = {"args": list(variables)} if variables else {}
    return Built(
        name=name,
        files=(File(path=DOCKERFILE, content=text.encode()), *map(_file, entries)),
        build=args,
        moving=moving,
    )


def _from_folder(cdf: ContainerDefinition, name: str, listing: Listing, read: Read) -> Built:
    errors = FieldErrors(cdf)
    folder = cdf.context or posixpath.dirname(cdf.dockerfile)
    none: list[ContextFile] = []
    entries = errors.attempt("dockerfile", lambda: folder_entries(folder, listing, read), none)
    errors.raise_any()
    paths = {entry.path for entry in entries}
    below = posixpath.relpath(cdf.dockerfile, folder)
    if below.startswith("../"):  # Compose takes one from outside of the context, but not into another folder
        below = next(n for n in (DOCKERFILE, f"{DOCKERFILE}.experiment", f"{DOCKERFILE}.srprov") if n not in paths)
    own = File(path=below, content=with_digests(cdf.dockerfile_text, cdf.pins).encode())
    build: dict[str, Any] = {"dockerfile": below} if below != DOCKERFILE else {}
    build |= {"args": dict(cdf.build_args)} if cdf.build_args else {}
    build |= {"target": cdf.target} if cdf.target else {}
    return Built(name=name, files=(own, *(_file(entry) for entry in entries if entry.path != below)), build=build)


def _file(entry: ContextFile) -> File:
    return File(path=entry.path, content=entry.content, mode=entry.mode, link=entry.link)
