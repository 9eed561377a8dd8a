"""How the services of an exported experiment find each other: what `x-srprov` of a Compose file says. Pure.

`srprov export compose` tells containers addresses that Compose gives them, in variables and files. Those are taken out
again, and the experiment gets the `network.discovery` that they came from, which gives them addresses of the overlay.
What another file says of a service is left as it is: the export did not write that.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from msgspec.structs import replace

from srprov.importing.normal import Normal, Note

KEY = "x-srprov"
_KINDS = ("static-peers", "discovery-server", "ros1", "zenoh")
_FOLDER = "/etc/srprov/"
"""Where containers find the files."""
_SAID = "the file was exported by srprov: `network.discovery` stands for what it tells containers of each other"


def restored(normal: Normal) -> tuple[Normal, dict[str, Any]]:
    """Return a project without what discovery told its services, and the EDF's `network`; or as it is, and nothing."""
    own = normal.document.get(KEY)
    told = own.get("told") if isinstance(own, Mapping) else None
    if not isinstance(own, Mapping) or own.get("discovery") not in _KINDS or not isinstance(told, Mapping):
        return normal, {}
    given = normal.document.get("services") or {}
    services = {name: _untold(name, one, told[name], normal) if name in told else one for name, one in given.items()}
    servers = own.get("discovery_servers")
    network = {"discovery": own["discovery"]}
    if isinstance(servers, list) and servers:
        network["discovery_servers"] = [str(one) for one in servers]
    note = Note(at=normal.position_of((KEY,)), message=_SAID)
    document = {**normal.document, "services": services}
    return replace(normal, document=document, warnings=(*normal.warnings, note)), network


def _untold(service: str, given: Mapping[str, Any], names: object, normal: Normal) -> dict[str, Any]:
    """Return a service without some variables, and without the files beside them, which come last."""
    told, own = (KEY, "told", service), ("services", service)
    listed = [str(one) for one in names] if isinstance(names, list) else []
    # of several lists one was made, whose parts are still each file's own
    said = {(name, normal.position_of((*told, at)).file) for at, name in enumerate(listed)}
    files = {file for _, file in said} | {normal.position_of(told).file}
    found = dict(given)
    if variables := given.get("environment"):
        where = {name: normal.position_of((*own, "environment", name)).file for name in variables}
        found["environment"] = {name: value for name, value in variables.items() if (name, where[name]) not in said}
    volumes = list(given.get("volumes") or ())
    while volumes and str(volumes[-1].get("target") or "").startswith(_FOLDER):
        if normal.position_of((*own, "volumes", len(volumes) - 1)).file not in files:
            break
        volumes.pop()
    if given.get("volumes"):
        found["volumes"] = volumes
    return found
