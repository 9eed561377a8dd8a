"""What a robot's Docker Engine says of itself, and where it keeps its data. Pure; what it says is untrusted.

Source: Docker Engine API 1.41 (`/_ping`, `/info`).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from srprov.facts.answers import Filesystem
from srprov.facts.model import Docker
from srprov.facts.probes import ENGINE, PROBES
from srprov.untrusted import folder, mapping, text
from srprov.wire import Reply


def read_engine(replies: Sequence[Reply]) -> tuple[Docker | None, str]:
    """Return the engine, or why there is none."""
    asked = replies[len(PROBES) : len(PROBES) + len(ENGINE)]
    if not asked:
        return None, "was not asked"
    said = [mapping(reply.json()) if reply.ok and reply.status == 200 else {} for reply in asked]
    ping, info = said[0], said[1] if len(said) > 1 else None
    name, api = _version(ping, info), text(ping.get("api-version"), length=16)
    if (info is not None and not name) or not re.fullmatch(r"[0-9]{1,3}\.[0-9]{1,4}", api):
        why = next((text(reply.err) for reply in asked if not reply.ok), "")
        return None, why or (
            f"the engine answered {asked[0].status}" if asked[0].status else "no Docker Engine answers"
        )
    if info is None:
        return Docker(version=name, api_version=api), ""
    options = info.get("SecurityOptions")
    docker = Docker(
        version=name,
        api_version=api,
        root=folder(info.get("DockerRootDir")),
        storage_driver=text(info.get("Driver"), length=32),
        log_driver=text(info.get("LoggingDriver"), length=64),
        rootless=isinstance(options, list)
        and any("rootless" in option for option in options if isinstance(option, str)),
    )
    return docker, ""


def _version(ping: Mapping[str, Any], info: Mapping[str, Any] | None) -> str:
    """Return the engine's version, which `Server: Docker/20.10.24 (linux)` says too."""
    if info is not None:
        return text(info.get("ServerVersion"), length=64)
    named = re.fullmatch(r"[A-Za-z]{1,20}/(\S{1,64})( .*)?", text(ping.get("server")))
    return named[1] if named else ""


def engine_disk(mounts: Sequence[Filesystem], root: str) -> Filesystem:
    """Return the filesystem that holds Docker's root: of those asked about, the one mounted deepest above it."""
    inside = (root or "/var/lib/docker").rstrip("/") + "/"
    above = [mount for mount in mounts if inside.startswith(mount.mount.rstrip("/") + "/")]
    return max(above, key=lambda m: len(m.mount), default=Filesystem(mount="", total=0, free=0))
