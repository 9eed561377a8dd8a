"""Whether what a plan file says of an image that srprov builds is what its build context says. Pure."""

from __future__ import annotations

from collections.abc import Collection

from srprov.controller.robot_images import base_name
from srprov.modules.image import ImageParams


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
