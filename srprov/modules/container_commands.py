"""What is told an engine to create, start, stop and remove a service's container, and the hashes of its configuration.

Source: Docker Engine API 1.41, "Create a container".
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from srprov.modules.container_body import PART_DIGITS, engine_body, parts_of
from srprov.modules.container_params import ContainerParams
from srprov.modules.module import (
    CONFIG_HASH,
    CONFIG_PARTS,
    INSTANCE,
    SERVICE,
    SOURCE,
    STOP_GRACE,
    TAKEN,
    canonical,
    digest,
)
from srprov.modules.mount_kind import links_refused
from srprov.modules.mount_places import places_refused
from srprov.untrusted import mapping
from srprov.wire import STOP_MARGIN_S, Command, EngineCall, Run, sh

NOT_OF_COMPOSE: Mapping[str, str] = MappingProxyType({
    "com.docker.compose.oneoff": "", "com.docker.compose.service": "",
})  # fmt: skip
"""Labels of every container that srprov makes. One has its image's labels, too, and by these alone Compose takes a
container for its service's: it makes that one anew, with the container's volumes in it, and the service's rights."""


def start(name: str) -> EngineCall:
    """Return what starts a container that was created, or has ended."""
    return EngineCall(method="POST", path=f"/containers/{name}/start")


def creation(name: str, want: ContainerParams, labels: Mapping[str, str] = MappingProxyType({})) -> tuple[Command, ...]:
    """Return what creates a container, with further labels."""
    body = engine_body(want)
    config_hash, parts = hashes(want)
    body["Labels"] = {
        **want.run.labels,
        **NOT_OF_COMPOSE,
        INSTANCE: want.instance,
        SERVICE: want.service,
        SOURCE: want.source,
        CONFIG_HASH: config_hash,
        CONFIG_PARTS: ",".join(f"{key}={value}" for key, value in sorted(parts.items())),
        STOP_GRACE: str(body["StopTimeout"]),
        TAKEN: " ".join(sorted(want.taken)),  # also if none: an image may have that label
        **labels,
    }
    # engines older than API 1.42 take CreateMountpoint without a word, and refuse the mount
    made = [str(m.get("Source")) for m in want.mounts if mapping(m.get("BindOptions")).get("CreateMountpoint") is True]
    folders = [Run(script=sh("mkdir", "-p", "--", path)) for path in made]
    create = EngineCall(
        method="POST", path="/containers/create", params=(("name", name),), body=canonical(body), accept=(201,)
    )
    return (*looks(name, want), *folders, create)


def looks(name: str, want: ContainerParams) -> tuple[Command, ...]:
    """Return what looks where mounted paths lead, and where they go: links are followed each time that it starts."""
    paths = links_refused(str(m.get("Source")) for m in want.mounts if m.get("Type") == "bind")
    return tuple(Run(script=script) for script in (paths, places_refused(name, want.mounts)) if script)


def stop(name: str, grace_s: float) -> EngineCall:
    """Return what asks a container's process to end, and kills it when its time is over."""
    # 304: it stopped already; 404: somebody removed it since
    return EngineCall(
        method="POST", path=f"/containers/{name}/stop", accept=(204, 304, 404), timeout_s=grace_s + STOP_MARGIN_S
    )


def remove(name: str) -> EngineCall:
    """Return what removes a container, running or not, with its anonymous volumes."""
    options = (("force", "true"), ("v", "true"))
    return EngineCall(method="DELETE", path=f"/containers/{name}", params=options, accept=(204, 404))


def hashes(want: ContainerParams) -> tuple[str, dict[str, str]]:
    """Return the hash of the whole configuration, and short ones of its parts."""
    parts = parts_of(want)
    return digest(parts), {name: digest(value, PART_DIGITS) for name, value in parts.items()}
