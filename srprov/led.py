"""Where a container has its mounts, by its engine's word, and where the robot's paths led when it was made.

The latter a label of the container says. Pure.
"""

from __future__ import annotations

import posixpath
from collections.abc import Mapping

from srprov.untrusted import absolute, json_or_none, mapping, mappings, string, string_map

LED = "srprov.led"
"""Label of a container: where the robot's paths led that it mounts, as JSON."""


def mounted_at(mount: Mapping[str, object]) -> str:
    """Return the one path of a mount in its container, by the engine's word, or nothing.

    What an image names without a slash, with two of them or with `..` is below the root all the same.
    """
    said = string(mount.get("Destination"))
    place = f"/{posixpath.normpath(f'/{said}').lstrip('/')}" if said else ""
    return absolute(place)


def led_of(inspected: object) -> dict[str, str]:
    """Return the robot's path -> where it led when a container was made that mounts it, by what its engine says.

    Only what the container mounts counts: it has its image's labels, too.
    """
    found = mapping(inspected)
    mounted = {string(one.get("Source")) for one in mappings(found.get("Mounts")) if one.get("Type") == "bind"}
    label = mapping(mapping(found.get("Config")).get("Labels")).get(LED)  # of a thousand paths, longer than any other
    led = string_map(json_or_none(label) if isinstance(label, str) else None)
    return {path: real for path, real in led.items() if path in mounted and absolute(path) and absolute(real)}
