"""Names that may move, in an experiment's definitions, and the same definitions with what they stand for.

Takes definitions; gives their images by tag and their branches, and definitions in which a digest or a commit stands in
place of each that is known. Whatever plans them needs no lock then. Pure, but for the files that are compared.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Iterator, Mapping

import msgspec
from msgspec.structs import replace

from srprov import datasets, disk
from srprov.definitions.containermodel import ContainerDefinition
from srprov.definitions.lockfile import Lock
from srprov.definitions.model import Definitions, Experiment
from srprov.errors import visible
from srprov.git_address import is_commit
from srprov.image_reference import Reference, parse_reference
from srprov.images.context import folder_items


class Names(msgspec.Struct, frozen=True):
    """What may move."""

    images: frozenset[str]
    """Full names with tags."""
    repositories: frozenset[tuple[str, str]]
    """(address, branch or tag)"""


def names_of(definitions: Definitions) -> Names:
    """Return every name that may lead elsewhere tomorrow. A variable in FROM is the builder's, and none of them."""
    named = [one.image for one in definitions.experiment.services.values()]
    named += [image for one in definitions.containers.values() for image in one.images]
    repositories = {(one.url, one.ref) for cdf in definitions.containers.values() for one in cdf.repositories}
    repositories |= {(url, ref) for _, url, ref in definitions.experiment.remote}
    return Names(
        frozenset(found.canonical for found in map(_reference, named) if found and not found.digest),
        frozenset(one for one in repositories if not is_commit(one[1])),
    )


def _reference(name: str) -> Reference | None:
    try:
        reference = parse_reference(name)
    except ValueError:
        return None
    return None if reference.is_of_a_build else reference


def pinned(definitions: Definitions, lock: Lock) -> Definitions:
    """Return the definitions with digests and commits where the lock has them."""
    containers = {key: _pinned_container(one, lock) for key, one in definitions.containers.items()}
    experiment = pinned_services(definitions.experiment, lock.digests)
    platforms = {with_digest(name, lock.digests): found for name, found in lock.platforms.items() if found}
    return replace(definitions, experiment=experiment, containers=containers, locked=lock.digests, platforms=platforms)


def pinned_services(experiment: Experiment, digests: Mapping[str, str]) -> Experiment:
    """Return the experiment with digests in place of its services' images."""
    services = {
        name: replace(one, image=with_digest(one.image, digests)) if one.image else one
        for name, one in experiment.services.items()
    }
    return replace(experiment, services=services)


def _pinned_container(one: ContainerDefinition, lock: Lock) -> ContainerDefinition:
    return replace(
        one,
        base=with_digest(one.base, lock.digests),
        image=with_digest(one.image, lock.digests),
        images=tuple(with_digest(name, lock.digests) for name in one.images),
        pins={name: found for name in one.images if (found := with_digest(name, lock.digests)) != name},
        repositories=tuple(
            replace(each, ref=commit, locked=each.ref) if (commit := lock.commits.get((each.url, each.ref))) else each
            for each in one.repositories
        ),
    )


def with_digest(name: str, digests: Mapping[str, str]) -> str:
    """Return an image's name by its digest, where that is known."""
    reference = _reference(name) if name else None
    digest = digests.get(reference.canonical) if reference and not reference.digest else None
    return Reference(reference.domain, reference.path, "", digest).familiar if reference and digest else name


def file_hashes(experiment: Experiment, containers: Iterable[ContainerDefinition]) -> dict[str, str]:
    """Return path from the EDF's folder -> sha256, of every file that the experiment is made of.

    What comes from a git repository is told by its commit.

    Raises:
        OSError: A file cannot be read, or all of them are too much.
    """
    paths = {*experiment.files, *_shipped(experiment, containers)}
    found = {}
    with disk.together():
        for path in sorted(paths):
            found[os.path.relpath(path, experiment.folder)] = hashlib.sha256(
                disk.read(os.path.realpath(path))
            ).hexdigest()
    for service in experiment.services.values():
        for mount in service.runtime.mounts:
            if mount.kind == "data" and mount.source:  # of any size; what is downloaded is named by its hash
                found[os.path.relpath(mount.source, experiment.folder)] = datasets.digest(mount.source)[0]
    return found


def _shipped(experiment: Experiment, containers: Iterable[ContainerDefinition]) -> Iterator[str]:
    for service in experiment.services.values():
        for mount in service.runtime.mounts:
            if mount.kind == "tree" or mount.seed:
                yield from _below(mount.seed.path if mount.seed else mount.source)
    for one in containers:
        for file in one.files:
            yield from _below(file.source)
        if one.dockerfile:
            yield one.dockerfile
            folder = one.context or os.path.dirname(one.dockerfile)
            yield from (os.path.join(folder, item.path) for item in folder_items(folder, disk.listing, disk.read)
                        if item.link is None)  # fmt: skip


def _below(path: str) -> Iterator[str]:
    yield from (os.path.join(path, one.path) if one.path else path for one in disk.shipped(path) if one.link is None)


def differences(definitions: Definitions, lock: Lock) -> list[str]:
    """Return in words, a line each, how the definitions, in which nothing is pinned, and the lock differ.

    Raises:
        OSError: A file cannot be read.
    """
    names = names_of(definitions)
    told = [f"{short(name)} is not in it" for name in sorted(names.images - lock.digests.keys())]
    told += [f"{short(name)} is in it, and no longer named" for name in sorted(lock.digests.keys() - names.images)]
    told += [f"{branch_text(one)} is not in it" for one in sorted(names.repositories - lock.commits.keys())]
    told += [
        f"{branch_text(one)} is in it, and no longer named" for one in sorted(lock.commits.keys() - names.repositories)
    ]
    hashes = file_hashes(definitions.experiment, definitions.containers.values())
    told += [f"the file {path} is not in it" for path in sorted(hashes.keys() - lock.files.keys())]
    told += [f"the file {path} is in it, and no longer there" for path in sorted(lock.files.keys() - hashes.keys())]
    same = hashes.keys() & lock.files.keys()
    told += [f"the file {path} has changed" for path in sorted(same) if hashes[path] != lock.files[path]]
    return [visible(one) for one in told]  # a file may have any name, and a lock be a stranger's


def short(name: str) -> str:
    """Return an image's name as Docker shows it."""
    reference = _reference(name)
    return reference.familiar if reference else name


def branch_text(one: tuple[str, str]) -> str:
    """Return (address, branch or tag) in words."""
    return f"{one[1] or 'the default branch'} of {one[0]}"
