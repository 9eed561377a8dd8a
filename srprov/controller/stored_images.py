"""The images on robots that srprov built, with sizes and who uses them. Asks robots, changes nothing.

An image is srprov's when it has a content tag and the label of its definition; or when it has no name at all, and is a
step of a build, or ends with what only srprov's Dockerfiles end with. Labels alone do not tell: whoever builds on an
image inherits those that it has, and whoever publishes one gives it any. So a step has the label, and what its build is
based on has not. Robots are asked in two round trips: all images and containers, then more of these.
"""

from __future__ import annotations

import concurrent.futures
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

import msgspec
from msgspec.structs import replace

from srprov.codes import Code
from srprov.controller.fleet import Fleet
from srprov.errors import TransportError
from srprov.layers import chain_ids, chain_sizes, read_image
from srprov.modules.container_leftover import BUILD
from srprov.modules.image import DEFINITION, IMAGE_ID, has_label, names_of
from srprov.modules.module import INSTANCE
from srprov.robot_answers import answers_of
from srprov.session import Reader
from srprov.untrusted import integer, mapping, mappings, string, string_map, text
from srprov.wire import EngineQuery, Reply

CONTENT_TAG = re.compile(r"(srprov/[a-z0-9]+(?:-[a-z0-9]+)*):[0-9a-f]{16}(?:[0-9a-f]{16})?")
"""Images that an older srprov built have half as many digits."""
_LAST_STEP = "LABEL srprov.instance="
"""In the history of an image: the end of what `images/mark.py` writes."""
_MOST = 500
"""Images of a robot whose layers are looked at; as when one is copied."""
_MOST_STEPS = 500
_LATEST = 4_000_000_000
"""No image is of a later second: no date can be made of any number."""
_IMAGES, _CONTAINERS = (EngineQuery(path=f"/{one}/json", params=(("all", "true"),)) for one in ("images", "containers"))
"""Also images below others: they tell whose a step is."""


class StoredImage(msgspec.Struct, frozen=True, kw_only=True):
    """One image on one robot."""

    id: str
    tags: tuple[str, ...] = ()
    """Content tags."""
    others: tuple[str, ...] = ()
    """Names that somebody else gave to it."""
    bytes_: int = 0
    """Of all layers, also those that other images have."""
    created: int = 0
    """When it was built: seconds since 1970, by the builder's clock."""
    definition: str = ""
    """Empty for a step of a build."""
    containers: tuple[tuple[str, str], ...] = ()
    """Name and instance of those that were made from it, running or not; the instance is empty where it is none."""
    steps: tuple[str, ...] = ()
    """Ids of the steps of its build that are kept below it and that nobody else named, newest first."""
    arch: str = ""
    layers: tuple[str, ...] = ()
    """Chain ids, from the base up."""

    @property
    def names(self) -> tuple[str, ...]:
        """Return how the engine is told which one is meant."""
        return self.tags or (self.id,)

    @property
    def instances(self) -> list[str]:
        """Return whose containers were made from it, where they are srprov's."""
        return sorted({instance for _, instance in self.containers if instance})

    @property
    def repositories(self) -> frozenset[str]:
        """Return its content tags without what the content made of them."""
        return frozenset(tag.rpartition(":")[0] for tag in self.tags)


class RobotStore(msgspec.Struct, frozen=True, kw_only=True):
    """What of srprov's images one robot has."""

    images: tuple[StoredImage, ...]
    sizes: Mapping[str, int] = msgspec.field(default_factory=dict)
    """Chain id of a layer -> bytes, of these images, as far as the engine's histories tell."""
    foreign: frozenset[str] = frozenset()
    """Chain ids that images of others have; only if they were asked about."""

    def bytes_of(self, images: Iterable[StoredImage]) -> int:
        """Return the bytes of images with each layer counted once."""
        return sum(self.sizes.get(layer, 0) for layer in {layer for one in images for layer in one.layers})

    def freed(self, gone: Collection[StoredImage]) -> int:
        """Return the bytes of layers that no image needs when these are gone."""
        ids = {one.id for one in gone}
        kept = self.foreign.union(*(one.layers for one in self.images if one.id not in ids))
        return sum(self.sizes.get(layer, 0) for layer in {layer for one in gone for layer in one.layers} - kept)


def stores(fleet: Fleet, *, whole: bool = False) -> tuple[dict[str, RobotStore], dict[str, str]]:
    """Ask all robots which images of srprov's they have.

    Args:
        fleet: The robots.
        whole: Also what images of others share with them, and the steps of builds.

    Returns:
        Robot -> what it has, and robot -> reason for those that cannot be asked.
    """
    found: dict[str, RobotStore] = {}
    unreachable: dict[str, str] = {}
    robots = sorted(fleet.inventory.hosts)
    with concurrent.futures.ThreadPoolExecutor(max(1, min(fleet.forks, len(robots)))) as pool:
        futures = {name: pool.submit(lambda one: _store(fleet.sessions.get(one), whole=whole), name) for name in robots}
        for name, future in futures.items():
            try:
                found[name] = future.result()
            except TransportError as error:
                unreachable[name] = error.told + (f"\n  {error.hint}" if error.hint else "")
    return found, unreachable


def _store(reader: Reader, *, whole: bool) -> RobotStore:
    """Ask one robot.

    Raises:
        TransportError: It or its engine does not answer, or has more than can be looked at.
    """
    first = reader.ask((_IMAGES, _CONTAINERS))
    if bad := next((reply for reply in first if not reply.ok), None):
        why = " ".join((bad.err or bad.out).split()) or f"status {bad.status}"
        raise TransportError(
            reader.host, f"its images cannot be listed: {text(why)}", hint="is its Docker Engine up?", code=Code.ENGINE
        )
    with answers_of(reader.host):
        listed = [one for one in mappings(first[0].json()) if IMAGE_ID.fullmatch(string(one.get("Id")))]
        ours = _with_users(_ours(listed), mappings(first[1].json()))
        others = _heads(listed) - {one.id for one in ours} if whole else set()
    if len(ours) + len(others) > _MOST:
        hint = "remove there what is not used any more: docker image prune"
        raise TransportError(reader.host, f"it has more than {_MOST} images", hint=hint, code=Code.ANSWER)
    paths = [f"/images/{one.id}/{what}" for one in ours for what in ("json", "history")]
    paths += [f"/images/{one}/json" for one in sorted(others)]
    second = reader.ask([EngineQuery(path=path) for path in paths]) if paths else ()
    with answers_of(reader.host):
        return _closer(ours, second)


def _ours(listed: Sequence[Mapping[str, Any]]) -> list[StoredImage]:
    """Return what may be srprov's; what has no name is looked at again."""
    by_id = {string(item.get("Id")): item for item in listed}
    heads, steps = _heads(listed), _on_bases(by_id)
    found: list[StoredImage] = []
    for key, item in by_id.items():
        every = [string(name) for name in names_of(item)]
        tags = tuple(sorted(name for name in every if CONTENT_TAG.fullmatch(name)))
        labels = string_map(item.get("Labels"))
        is_step = _is_marked(item) and not tags
        if key not in heads or not has_label(labels) or (every and not tags) or (is_step and key not in steps):
            continue
        if len(found) > _MOST:
            break  # they are too many, which `_store` says
        own = {tag.rpartition(":")[0] for tag in tags}
        others = {text(name) for name in every if name not in tags and name.partition("@")[0] not in own}
        one = StoredImage(
            id=key,
            tags=tags,
            others=tuple(sorted(others)),
            bytes_=integer(item.get("Size")),
            created=integer(item.get("Created"), high=_LATEST),
            definition="" if _is_marked(item) else text(labels.get(DEFINITION)),
            steps=tuple(_steps(key, by_id, steps)),
        )
        found.append(one)
    return sorted(found, key=lambda one: (not one.tags, one.names))


def _heads(listed: Iterable[Mapping[str, Any]]) -> set[str]:
    """Return the ids of images that have a name, or on which nothing is built."""
    parents = {string(one.get("ParentId")) for one in listed}
    return {key for one in listed if (key := string(one.get("Id"))) not in parents or names_of(one)}


def _steps(image: str, by_id: Mapping[str, Mapping[str, Any]], steps: Collection[str]) -> Sequence[str]:
    """Return the steps of the build below an image, as far down as they are marked and have no name."""
    row: list[str] = []
    below = string(by_id[image].get("ParentId"))
    while len(row) < _MOST_STEPS and (item := by_id.get(below)) and not names_of(item) and _is_marked(item):
        row.append(below)
        below = string(item.get("ParentId"))
    return row if row and row[-1] in steps else ()


def _on_bases(by_id: Mapping[str, Mapping[str, Any]]) -> set[str]:
    """Return the steps of builds whose base has not the mark: whoever builds on one that has it inherits it.

    Where the engine does not tell what one is based on, it is nobody's.
    """
    marked = {key for key, item in by_id.items() if _is_marked(item)}
    unnamed = {key for key in marked if not names_of(by_id[key])}
    found: dict[str, bool] = {}
    for key in sorted(marked):
        row, at = [key], string(by_id[key].get("ParentId"))
        while at in unnamed and at not in found and len(row) < _MOST_STEPS and at != key:
            row.append(at)
            at = string(by_id[at].get("ParentId"))
        is_on_base = found.get(at, False) if at in unnamed else at in by_id and at not in marked
        found |= dict.fromkeys(row, is_on_base)
    return {key for key, is_on_base in found.items() if is_on_base}


def _is_marked(item: Mapping[str, Any]) -> bool:
    return string_map(item.get("Labels")).get(INSTANCE) == BUILD


def _with_users(images: Iterable[StoredImage], containers: Iterable[Mapping[str, Any]]) -> list[StoredImage]:
    users: dict[str, list[Mapping[str, Any]]] = {}
    for one in containers:
        users.setdefault(string(one.get("ImageID")), []).append(one)
    return [replace(one, containers=tuple(sorted(map(_container, users.get(one.id, ()))))) for one in images]


def _container(item: Mapping[str, Any]) -> tuple[str, str]:
    given = item.get("Names")
    name = text(given[0]).removeprefix("/") if isinstance(given, list) and given else ""
    return name or text(item.get("Id"), length=12), text(string_map(item.get("Labels")).get(INSTANCE), length=32)


def _closer(images: Sequence[StoredImage], replies: Sequence[Reply]) -> RobotStore:
    """Add what a second look told of each image, then of those of others."""
    found: list[StoredImage] = []
    sizes: dict[str, int] = {}
    for one, about, history in zip(images, replies[::2], replies[1::2], strict=False):
        inspected, steps = about.json() if about.ok else None, history.json() if history.ok else None
        image = read_image(inspected)
        if not one.tags and one.definition and not _ends_as_ours(steps):
            continue  # somebody built it on one of ours
        sizes |= chain_sizes(image, steps) if image else {}
        arch = text(mapping(inspected).get("Architecture"), length=16)
        found.append(replace(one, arch=arch, layers=tuple(chain_ids(image.diff_ids)) if image else ()))
    others = [read_image(reply.json()) for reply in replies[2 * len(images) :] if reply.ok]
    foreign = {chain for image in others if image is not None for chain in chain_ids(image.diff_ids)}
    return RobotStore(images=tuple(found), sizes=sizes, foreign=frozenset(foreign))


def _ends_as_ours(history: object) -> bool:
    newest = next(iter(mappings(history)), {})
    return string(newest.get("CreatedBy")).rstrip().endswith(_LAST_STEP)
