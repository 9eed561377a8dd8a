"""No image fills a volume that another container may write to, which could lead the engine elsewhere meanwhile.

An engine that makes a container fills an empty volume with what the image has there, entry by entry, as root and among
the robot's own files; it follows a link that it finds in the place of a folder. A container that runs with the volume
puts one there once the first entry comes, and the rest of the image's files lies where that leads: any folder of the
robot. So does one that had the volume's folder handed to it, open, by a container that had the volume: no engine knows
of that. So no container of a service is made with named volumes to fill: what is empty, and no container has, is
filled in another place before (`filling.py`), and what is not is filled for nobody.

Source: moby, `daemon/volumes_unix.go` and containerd's `continuity/fs`; unix(7), SCM_RIGHTS; tried with Docker 20.10.
"""

from __future__ import annotations

import json
from collections.abc import Mapping

from msgspec.structs import replace

from srprov.execution.filling import FIRST_OF, filled
from srprov.modules.module import canonical
from srprov.modules.volume import create_volume
from srprov.session import Session
from srprov.untrusted import absolute, lines_of, mapping, mappings
from srprov.wire import Command, EngineCall, EngineQuery, Query, Reply, quote

_NONE = 404


def unfilled(command: Command, session: Session) -> Command | Reply:
    """Return a command that makes a container as one that has no volume filled; or as it is.

    Its volumes that are empty, and that no container has, are filled before. What goes wrong with that is an answer to
    the command.

    Raises:
        TransportError: The robot cannot be talked to any more.
    """
    if not isinstance(command, EngineCall) or command.path != "/containers/create":
        return command
    body = json.loads(command.body)
    mounts = [one for one in body.get("HostConfig", {}).get("Mounts", []) if _may_be_filled(one)]
    names = sorted({one["Source"] for one in mounts})
    if not names:
        return command
    replies = session.ask([ask(name) for name in names for ask in (_having, _about)])
    free: dict[str, str] = {}
    for name, listed, first in zip(names, replies[::2], replies[1::2], strict=True):
        about = first
        if first.status == _NONE:  # its engine would make it with the container
            session.execute(create_volume(name, {}))
            (about,) = session.ask([_about(name)])
        if not (listed.ok and about.ok):
            why = f"whether its image fills the volume {name} is not known: {listed.err or about.err}"
            return Reply(status=listed.status if about.ok else about.status, ok=False, err=why)
        if not _others_have(name, listed) and (place := _place(about)):
            free[name] = place
    empty, failed = _empty(free, session)
    if empty and not failed:
        failed = filled(command, body, empty, session)
    if failed:
        return failed
    for one in mounts:
        one["VolumeOptions"] = {**one.get("VolumeOptions", {}), "NoCopy": True}
    return replace(command, body=canonical(body))


def _may_be_filled(mount: dict[str, object]) -> bool:
    options = mount.get("VolumeOptions")
    alone = isinstance(options, dict) and options.get("NoCopy") is True
    return mount.get("Type") == "volume" and bool(mount.get("Source")) and not alone


def _others_have(name: str, reply: Reply) -> bool:
    """Return whether a container has a volume, by what an engine lists; also where it does not say so."""
    listed = reply.json()
    if not isinstance(listed, list):
        return True
    mounts = [one for container in mappings(listed) for one in mappings(container.get("Mounts"))]
    return any(one.get("Name") == name for one in mounts)


def _place(about: Reply) -> str:
    """Return the folder of a volume; empty: it has none of its own."""
    body = mapping(about.json())
    place, plain = absolute(body.get("Mountpoint")), body.get("Driver") == "local" and not body.get("Options")
    return place if plain else ""


def _empty(places: Mapping[str, str], session: Session) -> tuple[dict[str, str], Reply | None]:
    """Return the volumes in which there is nothing, or what went wrong."""
    if not places:
        return {}, None
    looks = [
        f'[ ! -d {quote(at)} ] || echo {n} "$(if mountpoint -q {quote(at)} 2>/dev/null; then echo /; fi; '
        f'{FIRST_OF.format(quote(at))})"'
        for n, at in enumerate(places.values())
    ]
    (said,) = session.ask([Query(command="\n".join([*looks, ":"]))])
    told = dict((f"{line} ").split(" ", 1) for line in lines_of(said.out, len(places))) if said.ok else {}
    for n, name in enumerate(places):
        if str(n) not in told:
            return {}, Reply(
                status=said.status, ok=False, err=f"the folder of the volume {name} is not seen on the robot"
            )
    return {name: at for n, (name, at) in enumerate(places.items()) if not told[str(n)].strip()}, None


def _having(name: str) -> EngineQuery:
    """Return what lists the containers, running or not, that have a volume."""
    return EngineQuery(path="/containers/json", params=(("all", "true"), ("filters", canonical({"volume": [name]}))))


def _about(name: str) -> EngineQuery:
    return EngineQuery(path=f"/volumes/{name}")
