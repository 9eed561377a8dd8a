"""The Dockerfiles that a plan would have built, to read. Asks no robot; asks git only where that is allowed."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence

from srprov import disk
from srprov.codes import Code
from srprov.controller.image_plans import plan_images
from srprov.controller.own_files import NO_ROBOTS, asked_for
from srprov.controller.permissions import permit_planning
from srprov.definitions.containermodel import ContainerDefinition
from srprov.definitions.model import Definitions, Inventory
from srprov.errors import DefinitionError, UsageError, visible
from srprov.git_address import is_commit
from srprov.images.plan import Checkout, ImagePlan
from srprov.images.tag import plan_image
from srprov.planning.policy import permissions


def dockerfiles(
    definitions: Definitions, services: Collection[str], allowed: Collection[str], inventory: Inventory = NO_ROBOTS
) -> list[str]:
    """Return a text for each definition of a container: what is known of its image, and the Dockerfile.

    Branches of code repositories are looked up with the permission `git` alone; without it, the text says that they
    are not. Each line is printable, whatever stands in the files. A tag is a hash of all that goes into an image: what
    is the user's own is asked for, as it is by a plan.

    Args:
        definitions: What was read, with what a lock says.
        services: Those whose images are shown; empty: all.
        allowed: Kinds of permission that the user gave.
        inventory: The user's, where he named one: it says which files are keys of robots.

    Raises:
        DefinitionError: The files name what was not fetched, or a field cannot become an image.
        RefusedError: What goes into an image is not the experiment's own, and the user did not allow it.
        UsageError: There is no such service.
    """
    if definitions.unsupported:
        raise DefinitionError(definitions.unsupported)
    known = definitions.experiment.services
    if unknown := sorted(set(services) - set(known)):
        raise UsageError(
            f"no service {', '.join(unknown)}", hint=f"there are: {', '.join(sorted(known))}", code=Code.NO_SUCH_NAME
        )
    found = asked_for(definitions, inventory)
    asked = permissions(found.experiment, found.containers)
    permit_planning([one for one in asked if one.kind in ("outside", "env")], allowed)
    users: dict[str, list[str]] = {}
    for name in sorted(services or known):
        one = known[name]
        users.setdefault(one.image or one.cdf, []).append(name)
    cdfs = {key: definitions.containers[key] for key in users if key in definitions.containers}
    fetch = not {"all", "git"}.isdisjoint(allowed)
    with disk.together():
        plans = _plans(cdfs, fetch=fetch)
    return [_shown(definitions, key, names, plans.get(key), fetch=fetch) for key, names in sorted(users.items())]


def _plans(cdfs: Mapping[str, ContainerDefinition], *, fetch: bool) -> Mapping[str, ImagePlan]:
    if fetch:
        return plan_images(cdfs)[0]
    built = {key: one for key, one in cdfs.items() if not one.image}
    return {key: plan_image(one, disk.listing, disk.read, _unfetched) for key, one in built.items()}


def _unfetched(cdf: ContainerDefinition, index: int) -> Checkout:
    """Return what is known of a code repository without a network: its commit, where the files or a lock name it."""
    ref = cdf.repositories[index].ref
    return Checkout(commit=ref if is_commit(ref) else f"(what {ref or 'the default branch'} is by then)", files=())


def _shown(definitions: Definitions, key: str, services: Sequence[str], plan: ImagePlan | None, *, fetch: bool) -> str:
    cdf = definitions.containers.get(key)
    if plan is None or cdf is None:
        return visible(f"# {', '.join(services)}: the ready image {cdf.image if cdf else key}; nothing is built")
    asked = any(definitions.experiment.services[name].runtime.pull_policy == "always" for name in services)
    head = [
        f"services: {', '.join(services)}",
        f"definition: {os.path.relpath(key, definitions.experiment.folder)}",
        f"image: {_tag(cdf, plan, fetch=fetch, asked=asked)}",
    ]
    if not plan.pinned and not asked:
        head.append("its base is not pinned: `srprov lock` writes down what it is now")
    lines = plan.dockerfile.rstrip("\n").split("\n")
    return "\n".join([*(visible(f"# {line}") for line in head), *map(_line, lines)])


def _tag(cdf: ContainerDefinition, plan: ImagePlan, *, fetch: bool, asked: bool) -> str:
    """Return the content tag, or say what goes into it that nobody looked up."""
    if asked and not plan.pinned:
        return "known when it is planned, with the digest that a registry gives its base then (pull_policy: always)"
    if cdf.repositories and not fetch:
        return "known when its code repositories are fetched, here with --allow git"
    return plan.tag


def _line(text: str) -> str:
    """Return a line of a Dockerfile as it stands there, tabs included, but nothing that moves a cursor."""
    return "\t".join(visible(part) for part in text.split("\t"))
