"""What else there is to say of each container: `status --wide`. One round trip to each robot; only reads.

Takes rows of `status` and sessions; gives the rows with what the engine says when it is asked for each container. That
is a robot's word: bounded in number and length, and times are times or nothing.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from srprov.errors import TransportError
from srprov.session import Session
from srprov.untrusted import integer, mapping, mappings, string, text
from srprov.wire import EngineQuery

_MOST = 200
"""Ports or mounts that are told of one container; of more their number."""
_UNKNOWN: Mapping[str, Any] = {
    "container": "", "state": "", "exit_code": None, "restarts": None, "started": None, "ended": None, "ports": [],
    "volumes": [],
}  # fmt: skip


def wide_rows(
    rows: Sequence[Mapping[str, Any]], addresses: Mapping[str, str], sessions: Mapping[str, Session]
) -> list[dict[str, Any]]:
    """Return rows of `status` with `wide`, as its schema describes it.

    Args:
        rows: As `status` has them.
        addresses: Robot -> the address by which this machine reaches it.
        sessions: Those of robots in reach.
    """
    ids: dict[str, list[str]] = {}
    for row in rows:
        if row["container"] and row["robot"] in sessions:
            ids.setdefault(row["robot"], []).append(row["container"])
    with ThreadPoolExecutor(max(1, len(ids))) as pool:
        every = pool.map(lambda robot: _read(robot, ids[robot], sessions[robot]), ids)
        found = {key: value for some in every for key, value in some.items()}
    return [
        {
            **row,
            "wide": {
                "robot_address": addresses.get(row["robot"], ""),
                **found.get((row["robot"], row["container"]), _UNKNOWN),
            },
        }
        for row in rows
    ]


def _read(robot: str, ids: Sequence[str], session: Session) -> dict[tuple[str, str], dict[str, Any]]:
    try:
        replies = session.ask([EngineQuery(path=f"/containers/{one}/json") for one in ids])
    except TransportError:  # whoever asked for the rows says which robots are away
        return {}
    return {
        (robot, one): _container(mapping(reply.json())) for one, reply in zip(ids, replies, strict=True) if reply.ok
    }


def _container(body: Mapping[str, Any]) -> dict[str, Any]:
    """Read what an engine says of one container when it is inspected."""
    state = mapping(body.get("State"))
    ports = _ports(mapping(mapping(body.get("NetworkSettings")).get("Ports")))
    # An engine lists mounts in another order each time.
    mounts = sorted(mappings(body.get("Mounts")), key=lambda one: string(one.get("Destination")))
    left_out = {"ports": len(ports) - _MOST, "volumes": len(mounts) - _MOST}
    status = text(state.get("Status"), length=20)
    return {
        "container": text(body.get("Name"), length=300).removeprefix("/"),
        "state": status,
        "exit_code": integer(state.get("ExitCode"), low=-(2**31), high=2**31) if status in ("exited", "dead") else None,
        "restarts": integer(body.get("RestartCount")),
        "started": _moment(state.get("StartedAt")),
        "ended": _moment(state.get("FinishedAt")) if status in ("exited", "dead") else None,
        "ports": ports[:_MOST],
        "volumes": [_mount(one) for one in mounts[:_MOST]],
        **{f"{what}_left_out": count for what, count in left_out.items() if count > 0},
    }


def _moment(said: object) -> str | None:
    """Return an engine's time to the second, in UTC; None for what is none, and for Go's time of nothing."""
    try:
        moment = dt.datetime.fromisoformat(f"{string(said)[:19]}+00:00")
    except ValueError:
        return None
    return moment.strftime("%Y-%m-%dT%H:%M:%SZ") if moment.year > 1 else None


def _ports(published: Mapping[str, Any]) -> list[dict[str, Any]]:
    found = []
    for name, ends in sorted(published.items()):
        port, _, protocol = name.partition("/")
        if not (port.isascii() and port.isdecimal() and len(port) <= 5 and protocol in ("tcp", "udp", "sctp")):
            continue
        for end in mappings(ends):
            at = string(end.get("HostPort"))
            outside = int(at) if at.isascii() and at.isdecimal() and len(at) <= 5 else None
            one = {"port": int(port), "protocol": protocol, "robot_port": outside}
            found.append({**one, "robot_address": text(end.get("HostIp"), length=60)})
    return found


def _mount(said: Mapping[str, Any]) -> dict[str, Any]:
    kind = text(said.get("Type"), length=20)
    return {
        "kind": kind,
        "source": text(said.get("Name" if kind == "volume" else "Source")),
        "target": text(said.get("Destination")),
        "read_only": said.get("RW") is False,
    }
