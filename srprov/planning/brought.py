"""What a step makes, which its line of a plan says whole: nothing of it is cut, and no secret hides it. Pure.

Which images its containers run, and are built of, is all that tells of files that a robot has and nobody was asked for:
it may have an image by a login of its owner's. Any port that nobody has at that moment may be published.
"""

from __future__ import annotations

import functools

from srprov import plain_tar
from srprov.definitions.dockerfile import images_of
from srprov.modules.container_form import told
from srprov.modules.container_params import ContainerParams
from srprov.modules.image import ImageParams
from srprov.planning.plan import Step
from srprov.resource import Action


def brought(step: Step) -> str:
    """Return in words what a step makes, such as `; image nav:1; publishes 8080:80/tcp`, or nothing."""
    params = step.want.params if step.want and step.change.action in (Action.CREATE, Action.REPLACE) else None
    if isinstance(params, ContainerParams):
        return told(params)
    if isinstance(params, ImageParams) and params.source == "build" and params.blob:
        named = images_of(_dockerfile(params.blob))
        return f"; made of {', '.join(named)}" if named else ""
    return ""


@functools.lru_cache(maxsize=64)  # a plan is shown in several forms, and a context may be large
def _dockerfile(context: bytes) -> str:
    try:
        found = next((one.content for one in plain_tar.members(context) if one.path == "Dockerfile"), None)
    except ValueError:  # who builds it says so
        found = None
    return (found or b"").decode("utf-8", "replace")
