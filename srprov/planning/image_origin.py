"""Where an image comes from, by its name: from a registry, or from what a robot has for somebody else. Pure."""

from __future__ import annotations

import re

from srprov.image_reference import parse_reference

_IMAGE_ID = re.compile(r"(sha256:)?[0-9a-f]+")


def not_from_a_registry(name: str) -> str:
    """Return why an image may be one that the robot has for somebody else, or nothing."""
    if "$" in name:
        return "which image that is only the builder knows"
    if _IMAGE_ID.fullmatch(name):
        return "perhaps the id of an image that is on the robot"
    try:
        reference = parse_reference(name)
    except ValueError:
        return "which image that is only the builder knows"
    return "built by srprov, perhaps for another experiment" if reference.is_of_a_build else ""
