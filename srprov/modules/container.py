"""Containers: one per service and robot.

Wanted parameters: `service`, `instance`, `source`, `image`, `job`, `run` (the merged run-time fields), `mounts`
(engine form), `network` (`mode` overlay, host or none; `name`, `ip`, `mac`, `hash`), `hostname`, `api` (the
engine's API version).

A container carries a hash of its whole configuration, and a short one of each part of it, as labels: what differs
can be said in words without comparing defaults that an engine fills in. Restarts follow from that hash alone.

Source: Docker Engine API 1.41, "Create a container".
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from srprov.modules.container_body import engine_body, parts_of
from srprov.modules.module import (
    CONFIG_HASH,
    CONFIG_PARTS,
    INSTANCE,
    LABEL_FILTER,
    SERVICE,
    SOURCE,
    STOP_GRACE,
    as_int,
    as_labels,
    as_list,
    as_text,
    canonical,
    digest,
)
from srprov.resource import Action, Change, Observed, Resource, State
from srprov.wire import AnyQuery, Command, EngineCall, EngineQuery, Reply

_EXITED = re.compile(r"^Exited \((-?[0-9]{1,9})\)")
_HEALTH = re.compile(r"\((healthy|unhealthy|health: starting)\)")


def container_name(instance: str, service: str) -> str:
    """Return the name of a service's container; an instance holds no dot, so two instances never meet."""
    return f"srprov.{instance}.{service}"


class ContainerModule:
    """The module of kind `container`."""

    kind = "container"

    def queries(self) -> tuple[AnyQuery, ...]:
        """List all labelled containers, running or not."""
        return (EngineQuery(path="/containers/json", params=(("all", "true"), ("filters", LABEL_FILTER))),)

    def parse(self, replies: Sequence[Reply]) -> tuple[Observed, ...]:
        """Read the list; the exit code and the health stand in Docker's status text."""
        if not replies[0].ok:
            return ()
        return tuple(found for item in as_list(replies[0].json()) if (found := _parse_one(item)))

    def check(self, want: Resource, found: State | None) -> Change | None:
        """Compare by hash, then by what the process does."""
        if found is None:
            return Change(action=Action.CREATE, cause="not there")
        wanted_hash, wanted_parts = _hashes(want.params)
        if found["hash"] != wanted_hash:
            return Change(action=Action.REPLACE, cause=_differing(found["parts"], wanted_parts), before=found)
        if cause := _wrong_address(want.params, found):
            return Change(action=Action.REPLACE, cause=cause, before=found)
        return _check_process(bool(want.params["job"]), found)

    def commands(self, want: Resource, change: Change) -> tuple[Command, ...]:
        """Create and start; replace stops and removes first; an update starts what stopped."""
        name = want.name
        start = EngineCall(method="POST", path=f"/containers/{name}/start")
        if change.action is Action.UPDATE:
            state = (change.before or {}).get("state")
            if state == "paused":
                return (EngineCall(method="POST", path=f"/containers/{name}/unpause"),)
            if state == "restarting":
                return (EngineCall(method="POST", path=f"/containers/{name}/restart"),)
            return (start,)
        body = engine_body(want.params)
        wanted_hash, parts = _hashes(want.params)
        body["Labels"] = {
            INSTANCE: want.params["instance"],
            SERVICE: want.params["service"],
            SOURCE: want.params["source"],
            CONFIG_HASH: wanted_hash,
            CONFIG_PARTS: ",".join(f"{key}={value}" for key, value in sorted(parts.items())),
            STOP_GRACE: str(body["StopTimeout"]),
        }
        create = EngineCall(
            method="POST", path="/containers/create", params=(("name", name),), body=canonical(body), accept=(201,)
        )
        if change.action is Action.REPLACE:
            return (*_stop_and_remove(name, change.before or {}), create, start)
        return (create, start)

    def removal(self, found: Observed) -> tuple[Command, ...]:
        """Stop with the container's own grace, then remove it with its anonymous volumes."""
        return _stop_and_remove(found.name, found.state)


def _stop_and_remove(name: str, state: State) -> tuple[Command, ...]:
    grace = float(state.get("stop_grace") or 10)
    return (
        # 304: it stopped already; 404: somebody removed it since
        EngineCall(method="POST", path=f"/containers/{name}/stop", accept=(204, 304, 404), timeout_s=grace + 60),
        EngineCall(
            method="DELETE", path=f"/containers/{name}", params=(("force", "true"), ("v", "true")), accept=(204, 404)
        ),
    )


def _parse_one(item: Mapping[str, Any]) -> Observed | None:
    labels = as_labels(item.get("Labels"))
    names = item.get("Names")
    # whoever runs an image that was committed from a container of ours inherits its labels, but not its name
    name = container_name(labels.get(INSTANCE, ""), labels.get(SERVICE, ""))
    if INSTANCE not in labels or not isinstance(names, list) or f"/{name}" not in names:
        return None
    status = as_text(item.get("Status"))
    exited, health = _EXITED.match(status), _HEALTH.search(status)
    state: dict[str, Any] = {
        "service": labels.get(SERVICE, ""),
        "source": labels.get(SOURCE, ""),
        "hash": labels.get(CONFIG_HASH, ""),
        "parts": dict(part.split("=", 1) for part in labels.get(CONFIG_PARTS, "").split(",") if "=" in part),
        "stop_grace": as_int(labels.get(STOP_GRACE, "10"), 10),
        "image": as_text(item.get("Image")),
        "id": as_text(item.get("Id"))[:12],
        "state": as_text(item.get("State")),
        "status": status,
        "exit_code": int(exited.group(1)) if exited else None,
        "health": health.group(1).replace("health: ", "") if health else "",
        "addresses": _ends(item.get("NetworkSettings"), "IPAddress"),
        "network_ids": _ends(item.get("NetworkSettings"), "NetworkID"),
    }
    return Observed(module="container", name=name, instance=labels[INSTANCE], state=state)


def _ends(settings: object, key: str) -> dict[str, str]:
    """Return network -> one value of the container's end there; a stopped container's has no address."""
    networks = settings.get("Networks") if isinstance(settings, Mapping) else None
    if not isinstance(networks, Mapping):
        return {}
    return {str(name): as_text(end.get(key)) for name, end in networks.items() if isinstance(end, Mapping)}


def _hashes(params: Mapping[str, Any]) -> tuple[str, dict[str, str]]:
    parts = {name: digest(value, 8) for name, value in parts_of(params).items()}
    return digest(parts_of(params)), parts


def _differing(found: Mapping[str, str], wanted: Mapping[str, str]) -> str:
    names = sorted(name for name in {*found, *wanted} if found.get(name) != wanted.get(name))
    if not names:
        return "configuration differs"
    return f"{', '.join(names)} {'differs' if len(names) == 1 else 'differ'}"


def _wrong_address(params: Mapping[str, Any], found: State) -> str:
    """A container that lost its network, or has another address than its peers' tables say, cannot be reached."""
    network = params["network"]
    if network["mode"] != "overlay" or found["state"] != "running":
        return ""
    address = found["addresses"].get(network["name"])
    if address is None:
        return f"not attached to network {network['name']}"
    return "" if address == network["ip"] else f"address is {address or 'none'}, not {network['ip']}"


def _check_process(job: bool, found: State) -> Change | None:
    state, code = found["state"], found["exit_code"]
    if state == "running" or (job and state == "exited" and code == 0):
        return None
    if state in ("dead", "removing"):
        return Change(action=Action.REPLACE, cause=f"container is {state}", before=found)
    causes = {
        "created": "created, never started",
        "paused": "paused",
        "restarting": "keeps restarting",
        "exited": f"{'job ' if job else ''}exited with code {code}",
    }
    return Change(action=Action.UPDATE, cause=causes.get(state, f"state is {state or 'unknown'}"), before=found)
