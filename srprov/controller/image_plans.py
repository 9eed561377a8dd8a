"""What a plan needs to know of images: what is built, what is a ready one, and what tags are at this moment.

Takes containers and the placement. Imports what builds, fetches and looks up only where something asks for it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from srprov.definitions.containermodel import ContainerDefinition
from srprov.definitions.model import Definitions, Experiment
from srprov.facts.model import Snapshot
from srprov.image_reference import parse_reference
from srprov.names import few
from srprov.resource import Observed, Resource

if TYPE_CHECKING:
    from srprov.controller.digests import AskEach
    from srprov.images.plan import ImagePlan
    from srprov.images.tag import Checkouts


def moved_tags(locked: Mapping[str, str], snapshot: Snapshot) -> tuple[str, ...]:
    """Return notes of tags that robots have for another digest than the lock; no registry is asked for it."""
    wanted = {parse_reference(name).familiar: digest for name, digest in locked.items()}
    moved: dict[tuple[str, str], list[str]] = {}
    for robot, items in sorted(snapshot.observed.items() if wanted else ()):
        images = [one for one in items if one.module == "image"]
        tagged = {one.state.get("id"): one.name for one in images if one.name in wanted}
        digests: dict[str, set[str]] = {}
        for one in images:
            repository, at, digest = one.name.partition("@")
            name = tagged.get(one.state.get("id"), "") if at else ""
            if name.rpartition(":")[0] == repository:
                digests.setdefault(name, set()).add(digest)
        for name, had in digests.items():
            if wanted[name] not in had:
                moved.setdefault((name, min(had)), []).append(robot)
    return tuple(_moved(name, found, wanted[name], robots) for (name, found), robots in sorted(moved.items()))


def _moved(name: str, found: str, locked: str, robots: Sequence[str]) -> str:
    return f"{name} has moved: it is {found[:19]}… on {few(robots, 3)}, the lock has {locked[:19]}…"


def with_fresh(
    definitions: Definitions,
    experiment: Experiment,
    placed: Mapping[str, str],
    reachable: Collection[str],
    ask: AskEach,
    allowed: Collection[str],
) -> tuple[Definitions, Experiment, tuple[str, ...]]:
    """Put in the digests of tags that shall be looked up for each plan; see `pull_policy.with_fresh`."""
    if all(one.runtime.pull_policy != "always" for one in experiment.services.values()):
        return definitions, experiment, ()
    from srprov.controller import pull_policy

    return pull_policy.with_fresh(definitions, experiment, placed, reachable, ask, allowed)


def images_alone(resources: Iterable[Resource]) -> tuple[Resource, ...]:
    """Return the images among resources that need nothing but each other; what else a playbook wants is left out."""
    images = {one.id: one for one in resources if one.module == "image"}
    while short := [key for key, one in images.items() if any(need.id not in images for need in one.needs)]:
        for key in short:
            del images[key]
    return tuple(images.values())


def images_there(snapshot: Snapshot) -> dict[str, tuple[Observed, ...]]:
    """Return the images of each robot."""
    return {host: tuple(one for one in items if one.module == "image") for host, items in snapshot.observed.items()}


def plan_images(containers: Mapping[str, ContainerDefinition]) -> tuple[dict[str, ImagePlan], dict[str, str]]:
    """Return CDF key -> what is built for it, and CDF key -> the ready image that it names."""
    references = {key: one.image for key, one in containers.items() if one.image}
    if len(references) == len(containers):
        return {}, references
    from srprov import disk
    from srprov.images.tag import no_repositories, plan_image  # not needed where nothing is built

    built = {key: one for key, one in containers.items() if not one.image}
    checkout: Checkouts = no_repositories
    if any(one.repositories for one in built.values()):
        from srprov.controller.repositories import Repositories

        checkout = Repositories(built.values()).checkout
    return {key: plan_image(one, disk.listing, disk.read, checkout) for key, one in built.items()}, references
