"""Whether what a plan file says of an image that srprov builds is what its build context says. Pure."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator

from srprov.controller.robot_images import base_name
from srprov.image_reference import is_plain
from srprov.modules.container_params import ContainerParams
from srprov.modules.image import ImageParams
from srprov.resource import Resource

_ID = re.compile("sha256:[0-9a-f]{64}")


def misnamed(wants: Iterable[Resource]) -> Iterator[str]:
    """Say which images have a name that is none, or another spelling of one: an engine would give them that one."""
    for want in wants:
        if want.module == "image" and not is_plain(want.name):
            yield f"{want.id}: no image is called that"
        elif isinstance(one := want.params, ContainerParams) and not (is_plain(one.image) or _ID.fullmatch(one.image)):
            yield f"{want.id}: no image is called {one.image[:100]!r}"


def is_own_image(want: ImageParams, name: str, context: bytes, built: Collection[tuple[str, str]]) -> bool:
    """Return whether a playbook could state an image that is built or copied.

    Args:
        want: What the plan says of it.
        name: Its content tag.
        context: Its build context, which has that tag.
        built: The (robot, image) that the plan builds.
    """
    if want.source == "build":
        return want.blob == context
    from srprov.images.tag import base_of

    # of the base's layers the robot that has the image need not show that it has them
    return want.base in ("", base_name(base_of(context))) and bool(want.id or (want.from_, name) in built)
