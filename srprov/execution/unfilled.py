"""No image fills a volume that another container may write to, which could lead the engine elsewhere meanwhile.

An engine that makes a container fills an empty volume with what the image has there, entry by entry, as root and among
the robot's own files; it follows a link that it finds in the place of a folder. A container that runs with the volume
puts one there once the first entry comes, and the rest of the image's files lies where that leads: any folder of the
robot. So a volume is filled for the first container that may write there, and for no later one. One that is not empty
is filled for nobody anyway.

Source: moby, `daemon/volumes_unix.go` and containerd's `continuity/fs`; tried with Docker 20.10.
"""

from __future__ import annotations

import json

from msgspec.structs import replace

from srprov.modules.module import canonical
from srprov.session import Session
from srprov.untrusted import mappings
from srprov.wire import Command, EngineCall, EngineQuery, Reply


def unfilled(command: Command, session: Session) -> Command:
    """Return a command that makes a container as one that has no volume filled where others may write; or as it is.

    Raises:
        TransportError: The robot cannot be talked to any more.
    """
    if not isinstance(command, EngineCall) or command.path != "/containers/create":
        return command
    body = json.loads(command.body)
    mounts = body.get("HostConfig", {}).get("Mounts", [])
    names = sorted({one["Source"] for one in mounts if _may_be_filled(one)})
    if not names:
        return command
    replies = session.ask([_having(name) for name in names])
    taken = {name for name, reply in zip(names, replies, strict=True) if _others_write(name, reply)}
    for one in mounts:
        if _may_be_filled(one) and one["Source"] in taken:
            one["VolumeOptions"] = {**one.get("VolumeOptions", {}), "NoCopy": True}
    return replace(command, body=canonical(body)) if taken else command


def _may_be_filled(mount: dict[str, object]) -> bool:
    options = mount.get("VolumeOptions")
    alone = isinstance(options, dict) and options.get("NoCopy") is True
    return mount.get("Type") == "volume" and bool(mount.get("Source")) and not alone


def _others_write(name: str, reply: Reply) -> bool:
    """Return whether a container may write to a volume, by what an engine lists; also where it does not say so."""
    listed = reply.json() if reply.ok else None
    if not isinstance(listed, list):
        return True
    mounts = [one for container in mappings(listed) for one in mappings(container.get("Mounts"))]
    return any(one.get("Name") == name and one.get("RW") is not False for one in mounts)


def _having(name: str) -> EngineQuery:
    """Return what lists the containers, running or not, that have a volume."""
    return EngineQuery(path="/containers/json", params=(("all", "true"), ("filters", canonical({"volume": [name]}))))
