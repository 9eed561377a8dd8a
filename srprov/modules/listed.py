"""How long what an engine lists of a container or a volume is at most, but for what an image says of it. Pure.

Source: Docker Engine API 1.41, "List containers" and "List volumes".
"""

from __future__ import annotations

import json

from srprov.modules.container_params import ContainerParams
from srprov.modules.volume import VolumeParams

_CONTAINER, _VOLUME = 2048, 512
"""Characters of keys, ids, times, hashes, and the names that srprov gives."""
_MOUNT, _EXPOSED, _PUBLISHED = 160, 40, 200
"""One that is published is listed for both kinds of addresses."""


def listed(name: str, params: object) -> int:
    """Return the characters of an entry in its engine's list; 0 for what no such list has."""
    if isinstance(params, ContainerParams):
        return _of_container(name, params)
    if isinstance(params, VolumeParams):
        labels = (params.source, params.owner, params.copy, params.services)
        return _VOLUME + 2 * len(json.dumps(name)) + len(json.dumps(labels))
    return 0


def _of_container(name: str, want: ContainerParams) -> int:
    run = want.run
    words = (
        *(name, want.image, want.source, want.service, want.network.name, want.taken, run.entrypoint, run.command),
        dict(run.labels),
        [dict(mount) for mount in want.mounts],
    )
    # a volume is told by its name and by its folder
    volumes = sum(len(str(mount.get("Source"))) for mount in want.mounts if mount["Type"] == "volume")
    ports = _PUBLISHED * len(run.ports) + _EXPOSED * len(run.expose)
    return _CONTAINER + len(json.dumps(words)) + volumes + _MOUNT * len(want.mounts) + ports
