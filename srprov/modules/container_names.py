"""What a service's container is called, and whose container one is. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from srprov.modules.module import INSTANCE, SERVICE
from srprov.untrusted import string_map


def container_name(instance: str, service: str) -> str:
    """Return the name of a service's container; an instance holds no dot, so two instances never meet."""
    return f"srprov.{instance}.{service}"


def instance_of(item: Mapping[str, Any]) -> str:
    """Return whose container one of an engine's list is; empty: no instance's.

    Whoever runs an image that has the labels, as one that was committed from such a container, has not its name.
    """
    labels, names = string_map(item.get("Labels")), item.get("Names")
    instance = labels.get(INSTANCE, "")
    name = container_name(instance, labels.get(SERVICE, ""))
    return instance if isinstance(names, list) and f"/{name}" in names else ""
