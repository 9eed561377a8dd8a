"""The folders that images are built from: a Dockerfile with its build context, one folder per CDF. Pure.

Takes CDFs and functions that read the controller's files; gives files. What is built is what srprov builds, but for its
label and the marks of its builds, whoever is given the folder: nothing is left for options of a builder to say.
"""

from __future__ import annotations

import hashlib
import itertools
import posixpath
import re
from collections.abc import Collection, Mapping

import msgspec

from srprov.definitions.containermodel import ContainerDefinition
from srprov.definitions.model import NO_REGISTRY
from srprov.definitions.repository_names import WHY, is_kept_name
from srprov.exporting.model import File
from srprov.exporting.variables import Open
from srprov.images.context import DOCKERFILE, Listing, Read, folder_entries
from srprov.images.dockerfile import FieldErrors
from srprov.images.plan import ContextFile
from srprov.images.tag import Checkouts, generated, repository_of, tailored

_OF_BUILDERS = frozenset({
    "dockerfile", "containerfile", "dockerfile.dockerignore", ".containerignore", "dockerfile.rego",
})  # fmt: skip
"""What builders look for at the top of a folder beside `.dockerignore`, some of them first; a disk may take any case.

A folder is none. Source: buildah's DiscoverContainerfile and ContainerIgnoreFile, podman-compose, Docker's `build -f`;
Docker's "Build policies": buildx evaluates `Dockerfile.rego` on this machine, and that chooses what is built on.
"""
_HASH_LENGTH = 32
_WHY = "a builder would go by it, and nobody looked at it"


class Built(msgspec.Struct, frozen=True, kw_only=True):
    """One image to be built."""

    name: str
    """Of its folder."""
    files: tuple[File, ...]
    """With paths below that folder."""
    variables: tuple[str, ...] = ()
    """What it takes of the environment of whoever builds it."""
    moving: tuple[str, ...] = ()
    """In words, which commit its code repositories are now, and what of its files is left out."""


def image_name(experiment: str, of: str, one: Built) -> str:
    """Return the name of an image that is built, which changes with the content of its folder.

    Its registry is none, so that a node without the image fails: as `NAME/…` it would take what somebody of that name
    has on Docker Hub. No other experiment has an image of such a name: the hash has both names whole, since not each
    may stand in an image's, such as `nav-`.
    """
    sums = sorted(f"{one.path}\0{one.mode}\0{one.link}\0{hashlib.sha256(one.content).hexdigest()}" for one in one.files)
    made = hashlib.sha256("\n".join((experiment, of, *sums)).encode()).hexdigest()[:_HASH_LENGTH]
    return f"{NO_REGISTRY}/{_as_part(experiment)}/{_as_part(of)}:{made}"


def _as_part(name: str) -> str:
    """Return a name, which begins with a letter or digit, as Docker allows it between two `/` of an image's."""
    return re.sub(r"[^a-z0-9]+", "-", name).strip("-")


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
    left_out = [entry.path for entry in entries if is_kept_name(entry.path)]
    return Built(
        name=name,
        files=(
            File(path=DOCKERFILE, content=text.encode()),
            *(_file(entry) for entry in entries if not is_kept_name(entry.path)),
        ),
        variables=variables,
        moving=(*moving, *(f"{name}: {one[:200]} and the like are left out: {WHY}" for one in left_out[:1])),
    )


def _from_folder(cdf: ContainerDefinition, name: str, listing: Listing, read: Read) -> Built:
    """Return the folder of a Dockerfile, in which the text that was looked at is the only one that a builder takes.

    What else a builder may take for one is left out, or for what says which files it sends: nobody looked at it.
    """
    errors = FieldErrors(cdf)
    folder = cdf.context or posixpath.dirname(cdf.dockerfile)
    none: list[ContextFile] = []
    text = errors.attempt("dockerfile", lambda: tailored(cdf), "")
    entries = errors.attempt("dockerfile", lambda: folder_entries(folder, listing, read), none)
    errors.raise_any()
    own = File(path=DOCKERFILE, content=text.encode())
    others = [entry for entry in entries if not _is_taken_for_one(entry.path)]
    kept = {cdf.dockerfile, *(posixpath.join(folder, one.path) for one in others)}
    gone = (one.path for one in entries if posixpath.join(folder, one.path) not in kept)
    told = (f"{name}: {path[:200]} is left out: {_WHY}" for path in gone)
    return Built(name=name, files=(own, *map(_file, others)), moving=tuple(told))


def _is_taken_for_one(path: str) -> bool:
    """Return whether a builder could take a file for a Dockerfile, or it has the place of that; a folder is none."""
    top, slash, _ = path.partition("/")
    return top == DOCKERFILE or (not slash and top.casefold() in _OF_BUILDERS)


def _file(entry: ContextFile) -> File:
    return File(path=entry.path, content=entry.content, mode=entry.mode, link=entry.link)
