"""What a step makes, in words, which a plan says whole: nothing of it is cut, and no secret hides it. Pure.

Which images its containers run, and are built of, is all that tells of files that a robot has and nobody was asked for:
it may have an image by a login of its owner's. Any port that nobody has at that moment may be published.
"""

from __future__ import annotations

from srprov import plain_tar
from srprov.definitions.dockerfile import images_of
from srprov.modules.container_form import told
from srprov.modules.container_params import ContainerParams
from srprov.modules.image import ImageParams
from srprov.resource import Action, Change, Resource


def brought(want: Resource, change: Change) -> str:
    """Return in words what a change makes, such as `image nav:1; publishes 8080:80/tcp`, or nothing."""
    params = want.params if change.action in (Action.CREATE, Action.REPLACE) else None
    if isinstance(params, ContainerParams):
        return told(params)
    if isinstance(params, ImageParams) and params.source == "build" and params.blob:
        named = images_of(_dockerfile(params.blob))
        return f"made of {', '.join(named)}" if named else ""
    return ""


def _dockerfile(context: bytes) -> str:
    try:
        found = next((one.content for one in plain_tar.members(context) if one.path == "Dockerfile"), None)
    except ValueError:  # who builds it says so
        found = None
    return (found or b"").decode("utf-8", "replace")
