"""The images of srprov's on robots, as JSON and as rows of a table. Pure, but for the definitions that it reads."""

from __future__ import annotations

import datetime as dt
from collections.abc import Collection, Iterator, Mapping
from typing import Any

from srprov.codes import Code
from srprov.controller.kept import age_text
from srprov.controller.stored_images import RobotStore, StoredImage
from srprov.definitions import load_experiment
from srprov.errors import UsageError
from srprov.images.tag import repository_of
from srprov.modules.container_leftover import BUILD
from srprov.sizes import size_text
from srprov.transport.blobs import Blobs

COLUMNS = ("robot", "image", "arch", "size", "built", "used by")
Named = Mapping[str, Collection[str]]
"""Image -> the instances whose last run named it."""


def cache_size() -> tuple[str, int]:
    """Return the folder of the cache of layers on this machine, and its bytes."""
    cache = Blobs()
    return str(cache.folder), cache.total()


def clear_cache() -> int:
    """Remove all layers that are kept on this machine, and return how many bytes that were.

    Raises:
        UsageError: One cannot be removed.
    """
    try:
        return Blobs().clear()
    except OSError as error:
        raise UsageError(f"cannot remove {error.filename}: {error.strerror}", code=Code.CANNOT_WRITE) from error


def repositories_of(file: str) -> frozenset[str]:
    """Return `srprov/NAME` of every definition of an experiment that is built; those in git are not fetched for it.

    Raises:
        DefinitionError: It is not valid.
    """
    return frozenset(repository_of(one) for one in load_experiment(file).containers.values() if not one.image)


def of_experiment(store: RobotStore, repositories: Collection[str]) -> RobotStore:
    """Return what of a robot's images has a content tag of these repositories."""
    images = tuple(one for one in store.images if not one.repositories.isdisjoint(repositories))
    return RobotStore(images=images, sizes=store.sizes, foreign=store.foreign)


def robots_json(there: Mapping[str, RobotStore], named: Named) -> dict[str, Any]:
    """Return robot -> its images and their bytes, as `schemas/images.schema.json` has it."""
    return {
        robot: {"bytes": store.bytes_of(store.images), "images": [_image_json(one, named) for one in store.images]}
        for robot, store in sorted(there.items())
    }


def _image_json(one: StoredImage, named: Named) -> dict[str, Any]:
    return {
        "id": one.id,
        "tags": list(one.tags),
        "other_names": list(one.others),
        "definition": one.definition,
        "arch": one.arch,
        "bytes": one.bytes_,
        "created": _built(one),
        "containers": [name for name, _ in one.containers],
        "instances": one.instances,
        "named_by": _named_by(one, named),
    }


def rows(robot: str, images: Collection[StoredImage], named: Named, now: dt.datetime) -> Iterator[dict[str, str]]:
    """Yield a row per image."""
    for one in images:
        yield {
            "robot": robot,
            "image": ", ".join(one.tags) or f"{one.id[:19]} (no name)",
            "arch": one.arch,
            "size": size_text(one.bytes_),
            "built": f"{age_text(_built(one), now)} ago" if one.created else "",
            "used by": "; ".join(_users(one, named)) or "nobody",
        }


def _users(one: StoredImage, named: Named) -> Iterator[str]:
    strange = sum(not instance for _, instance in one.containers)
    yield from ("a container that a build left" if name == BUILD else name for name in one.instances)
    if strange:
        yield f"{strange} containers of others" if strange > 1 else "a container of others"
    if last := [name for name in _named_by(one, named) if name not in one.instances]:
        yield f"the last run of {', '.join(last)}"
    if one.others:
        yield f"also named {', '.join(one.others)}"


def _named_by(one: StoredImage, named: Named) -> list[str]:
    return sorted({instance for tag in one.tags for instance in named.get(tag, ())})


def _built(one: StoredImage) -> str:
    return dt.datetime.fromtimestamp(one.created, dt.timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ")
