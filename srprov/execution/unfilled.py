"""No image fills a volume that another container may write to, which could lead the engine elsewhere meanwhile.

An engine that makes a container fills an empty volume with what the image has there, entry by entry, as root and among
the robot's own files; it follows a link that it finds in the place of a folder. A container that runs with the volume
puts one there once the first entry comes, and the rest of the image's files lies where that leads: any folder of the
robot. So does one that had the volume's folder handed to it, open, by a container that had the volume: no engine knows
of that. So a volume is filled while no container has it, and it gets a new folder first, of which nobody holds anything
(one that only reads would be left with the old one). One that is not empty is filled for nobody.

Source: moby, `daemon/volumes_unix.go` and containerd's `continuity/fs`; unix(7), SCM_RIGHTS; rename(2), which takes the
place of an empty folder alone; tried with Docker 20.10.
"""

from __future__ import annotations

import json

from msgspec.structs import replace

from srprov.modules.module import canonical
from srprov.session import Session
from srprov.untrusted import mappings, string
from srprov.wire import Command, EngineCall, EngineQuery, Reply, Run, quote

_NONE, _NOT_EMPTY = 404, 3
_RENEW = f"""new=$to.new; rmdir "$new" 2>/dev/null
mkdir "$new" && chown "$(stat -c %u:%g "$to")" "$new" && chmod "$(stat -c %a "$to")" "$new" || exit 1
mv -T "$new" "$to" 2>/dev/null && exit
rmdir "$new"; exit {_NOT_EMPTY}"""
"""Renames an empty folder to `$to`, in whose place it comes only if that is empty, too."""


def unfilled(command: Command, session: Session) -> Command | Reply:
    """Return a command that makes a container as one that has no volume filled where others may write; or as it is.

    What a robot says where a volume's folder cannot be renewed, though it is empty, is an answer to that command.

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
    replies = session.ask([ask(name) for name in names for ask in (_having, _about)])
    taken = set[str]()
    for name, listed, about in zip(names, replies[::2], replies[1::2], strict=True):
        renewed = None if _others_have(name, listed) else _renewed(about, session)
        if renewed is None or renewed.status == _NOT_EMPTY:
            taken.add(name)
        elif not renewed.ok:
            return renewed
    for one in mounts:
        if _may_be_filled(one) and one["Source"] in taken:
            one["VolumeOptions"] = {**one.get("VolumeOptions", {}), "NoCopy": True}
    return replace(command, body=canonical(body)) if taken else command


def _may_be_filled(mount: dict[str, object]) -> bool:
    options = mount.get("VolumeOptions")
    alone = isinstance(options, dict) and options.get("NoCopy") is True
    return mount.get("Type") == "volume" and bool(mount.get("Source")) and not alone


def _others_have(name: str, reply: Reply) -> bool:
    """Return whether a container has a volume, by what an engine lists; also where it does not say so."""
    listed = reply.json() if reply.ok else None
    if not isinstance(listed, list):
        return True
    mounts = [one for container in mappings(listed) for one in mappings(container.get("Mounts"))]
    return any(one.get("Name") == name for one in mounts)


def _renewed(about: Reply, session: Session) -> Reply | None:
    """Give an empty volume another folder, of which nobody holds anything; None where it is not known where it lies."""
    if about.status == _NONE:
        return Reply(status=0)  # it is made with the container, by its engine
    body = about.json() if about.ok else None
    place = string(body.get("Mountpoint")) if isinstance(body, dict) else ""
    return session.execute(Run(script=f"to={quote(place)}; {_RENEW}")) if place.startswith("/") else None


def _having(name: str) -> EngineQuery:
    """Return what lists the containers, running or not, that have a volume."""
    return EngineQuery(path="/containers/json", params=(("all", "true"), ("filters", canonical({"volume": [name]}))))


def _about(name: str) -> EngineQuery:
    return EngineQuery(path=f"/volumes/{name}")
