"""Empty volumes get what an image has for them, and no engine ever fills one that a service has.

An engine goes on with a container that it makes when nobody waits for it any more: after Ctrl-C, a lost connection, or
the time that it has. It goes on filling the container's volumes by then, as root and by their paths, while the next
service is given one of them, and leads it by links to any folder of the robot. So a container that is never started
has the image fill new volumes, whose names nobody knows; these become the real ones by a rename, once the engine said
that it is done. One that is late fills what no container has.

Source: moby, `daemon/volumes_unix.go`; tried with Docker 20.10.
"""

from __future__ import annotations

import secrets
from collections.abc import Mapping
from typing import Any

from srprov.modules.container_commands import NOT_OF_COMPOSE, remove
from srprov.modules.container_leftover import BUILD, FILLING
from srprov.modules.module import INSTANCE, SOURCE, canonical
from srprov.modules.volume import HALF, create_volume, remove_volume
from srprov.session import Session
from srprov.untrusted import absolute, mapping, string_map
from srprov.wire import EngineCall, EngineQuery, Reply, Run, quote

_FILL_S = 900.0
"""An image's files for a volume may be many."""
_ALIKE = 'chown "$(stat -c %u:%g "$to")" "$from" && chmod "$(stat -c %a "$to")" "$from" || exit'
"""An image that has nothing there leaves it so; one that has a folder there gives it the owner and mode of that."""

FIRST_OF = "find {} -mindepth 1 -maxdepth 1 | head -c 1"
"""Prints `/` where anything is in a folder, whatever its name; a word of a shell goes in."""
_IN_IT = FIRST_OF.format('"$to"')
_TAKE_PLACE = f'mv -T "$from" "$to" && mkdir "$from" || [ "$({_IN_IT})" ] || exit'
"""Renames a folder to one that is empty; where it is not by now, it keeps what it has."""


def filled(create: EngineCall, body: Mapping[str, Any], empty: Mapping[str, str], session: Session) -> Reply | None:
    """Fill volumes as the container would have them filled that is to be made; return what went wrong, or None.

    Args:
        create: What makes that container.
        body: What it says.
        empty: Volume that is empty, and that no container has -> its folder on the robot.
        session: The robot's, which is locked.

    Raises:
        TransportError: The robot cannot be talked to any more.
    """
    word = secrets.token_hex(6)
    new = {name: f"{HALF}.fill-{word}-{number}" for number, name in enumerate(sorted(empty))}
    labels = string_map(body.get("Labels"))
    own = {key: labels[key] for key in (INSTANCE, SOURCE) if key in labels}
    for fresh in new.values():
        made = session.execute(create_volume(fresh, own))
        if not made.ok:
            return made
    lines, failed = _lines({new[name]: place for name, place in empty.items()}, session)
    failed = failed or session.execute(Run(script="\n".join(f"{line} {_ALIKE}" for line in lines)))
    if not failed.ok:
        return failed
    filler = f"{FILLING}{word}"
    made = session.execute(_filler(create, body, filler, new))
    if not made.ok and not made.status:
        return made  # it may go on for long: a run after its end removes what it leaves
    removed = [session.execute(remove(filler))]
    if made.ok and removed[0].ok:
        removed.append(session.execute(Run(script="\n".join(f"{line} {_TAKE_PLACE}" for line in lines))))
    removed += [session.execute(remove_volume(one)) for one in new.values()]
    return next((one for one in (made, *removed) if not one.ok), None)


def _filler(create: EngineCall, body: Mapping[str, Any], name: str, new: Mapping[str, str]) -> EngineCall:
    mounts = [
        {"Type": "volume", "Source": new[one["Source"]], "Target": one["Target"]}
        for one in body["HostConfig"]["Mounts"]
        if one.get("Source") in new and one.get("VolumeOptions", {}).get("NoCopy") is not True
    ]
    made = {
        "Image": body["Image"],
        "Entrypoint": ["-"],  # it is never started
        "Cmd": [],
        "Labels": {INSTANCE: BUILD, **NOT_OF_COMPOSE},
        "Healthcheck": {"Test": ["NONE"]},
        "HostConfig": {"NetworkMode": "none", "Mounts": mounts},
    }
    params = (("name", name), *((key, value) for key, value in create.params if key != "name"))
    return EngineCall(
        method="POST", path=create.path, params=params, body=canonical(made), accept=(201,), timeout_s=_FILL_S
    )


def _lines(to: Mapping[str, str], session: Session) -> tuple[list[str], Reply | None]:
    """Return for each new volume what names its folder and that of the real one, or what went wrong.

    `to` is new volume -> folder of the real one.
    """
    lines = []
    for reply, place in zip(session.ask([EngineQuery(path=f"/volumes/{one}") for one in to]), to.values(), strict=True):
        lies = absolute(mapping(reply.json() if reply.ok else None).get("Mountpoint"))
        if not lies:
            why = f"where a new volume lies is not told {reply.err}".rstrip()
            return [], Reply(status=reply.status, ok=False, err=why)
        lines.append(f"from={quote(lies)} to={quote(place)};")
    return lines, None
