"""Containers: one per service and robot.

A container carries a hash of its whole configuration, and a short one of each part of it, as labels: what differs
can be said in words without comparing defaults that an engine fills in. Restarts follow from that hash alone.

Source: Docker Engine API 1.41, "Create a container".
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from typing import Any
from urllib.parse import quote as url_quote

from srprov.definitions.model import Service
from srprov.modules import container_form, container_values
from srprov.modules.container_body import differing
from srprov.modules.container_commands import creation, hashes, looks, remove, start, stop
from srprov.modules.container_leftover import BUILD, end_process, left_by_build
from srprov.modules.container_limits import QUERY as LIMITS
from srprov.modules.container_limits import changed_limits, limits_of, of_builds
from srprov.modules.container_names import container_name, instance_of
from srprov.modules.container_orders import not_ordered, ordered_commands
from srprov.modules.container_params import ContainerParams
from srprov.modules.container_status import reached
from srprov.modules.module import (
    CONFIG_HASH,
    CONFIG_PARTS,
    INSTANCE,
    LABEL_FILTER,
    SERVICE,
    SOURCE,
    STOP_GRACE,
    TAKEN,
    Module,
    Names,
)
from srprov.resource import Action, Change, Difference, Observed, State
from srprov.untrusted import integer, mappings, string, string_map
from srprov.wire import AnyQuery, Command, EngineCall, EngineQuery, Query, Reply, sh

_LONGEST_GRACE_S = 7 * 86_400
"""A robot's label may say anything; a run's --stop-timeout is shorter."""
_EXITED = re.compile(r"^Exited \((-?[0-9]{1,9})\)")
_NEVER_RUN = {
    # the engine may have died while it started it, and then refuses to start it for ever
    "created": "created, never started",
    "dead": "container is dead",
    "removing": "container is removing",
}
"""State of a container that is made anew -> the cause of that."""
_STATE = re.compile(r"[a-z]{1,20}")
_HEALTH = re.compile(r"\((healthy|unhealthy|health: starting)\)")


class ContainerModule(Module[ContainerParams]):
    """The module of kind `container`."""

    kind = "container"
    params = ContainerParams
    on_overlay = True

    def queries(self) -> tuple[AnyQuery, ...]:
        """List all labelled containers, running or not, and what the engine keeps of the limits of any."""
        return (EngineQuery(path="/containers/json", params=(("all", "true"), ("filters", LABEL_FILTER))), LIMITS)

    def parse(self, replies: Sequence[Reply]) -> tuple[Observed, ...]:
        """Read the list; the exit code and the health stand in Docker's status text."""
        if not replies[0].ok:
            return ()
        limits, builds = limits_of(replies[1]), of_builds(replies[1])
        return tuple(found for item in mappings(replies[0].json()) if (found := _parse_one(item, limits, builds)))

    def check(self, name: str, want: ContainerParams, found: State | None) -> Change | None:
        """Compare by hash, then by what the process does."""
        if found is None:
            return Change(action=Action.CREATE, cause="not there", commands=_create_and_start(name, want))
        if found["hash"] != hashes(want)[0]:
            return _replacement(name, want, found, differing(found["parts"], want))
        if cause := changed_limits(want, found["limits"]) or _wrong_address(want, found):
            return _replacement(name, want, found, cause)
        if found["state"] in _NEVER_RUN:
            return _replacement(name, want, found, _NEVER_RUN[found["state"]])
        return _check_process(name, want, found)

    def old_queries(self, name: str, want: ContainerParams, found: State) -> tuple[AnyQuery, ...]:
        """Inspect it, and the image that it was made of."""
        if found["hash"] == hashes(want)[0]:
            return ()
        image = url_quote(found["image"] or "none", safe="/:@")
        return (self.status_query(name), EngineQuery(path=f"/images/{image}/json"))

    def differences(self, want: ContainerParams, found: State, replies: Sequence[Reply]) -> tuple[Difference, ...]:
        """Compare field by field what the hashes of its parts say to be different."""
        return () if found["hash"] == hashes(want)[0] else container_values.differing_values(want, found, replies)

    def between(self, old: ContainerParams, new: ContainerParams) -> tuple[Difference, ...]:
        """Compare field by field."""
        return container_values.between(old, new)

    def removal(self, found: Observed) -> tuple[Command, ...]:
        """Stop with the container's own grace, then remove it with its anonymous volumes."""
        return _stop_and_remove(found.name, found.state)

    def removed_before(self, other: str) -> bool:
        """Go first: a container may use whatever there is."""
        return other != self.kind

    def made_after_removal_of(self, other: str) -> bool:
        """Wait for ports, devices and names to be free."""
        return other == self.kind

    def stands_on(self, found: State) -> Collection[tuple[str, str]]:
        """Return the networks that it is attached to."""
        return [("network", name) for name in found["addresses"]]

    def stranded(self, want: ContainerParams, found: State, others: Mapping[tuple[str, str], State]) -> str:
        """Compare networks by id: Docker starts a container on the very network that it was made on, or never again."""
        name = want.network.name
        if name is None:
            return ""
        network, holds = others.get(("network", name)), found["network_ids"].get(name)
        # one that was never started has no id yet: Docker looks its network up by name
        lost = holds is None or (holds != "" and (network is None or holds != network["id"]))
        return "its network was removed" if lost else ""

    def is_own(self, name: str, want: ContainerParams, names: Names) -> bool:
        """Compare name, owner, network and mounts."""
        return name == container_name(want.instance, want.service) and container_form.is_own(want, names)

    def service_of(self, name: str, want: ContainerParams) -> Service:
        """Read it back from the engine's form."""
        return container_form.service_of(want)

    def status_query(self, name: str) -> EngineQuery:
        """Inspect it."""
        return EngineQuery(path=f"/containers/{url_quote(name, safe='')}/json")

    def reached(self, name: str, condition: str, reply: Reply) -> tuple[bool, str]:
        """Judge by its state, its exit code and its health."""
        return reached(name, condition, reply)

    def amiss(self, want: ContainerParams, found: State) -> str:
        """Name a job that has failed, and a process that its healthcheck finds unwell."""
        if want.job and found["state"] == "exited" and found["exit_code"] != 0:
            return f"is a job that ended with code {found['exit_code']}"
        return "is unhealthy" if found["state"] == "running" and found["health"] == "unhealthy" else ""

    def order(self, found: Observed, verb: str) -> tuple[Command, ...]:
        """Stop it, start it, or both."""
        return ordered_commands(found, verb)

    def ordered(self, found: State, verb: str) -> str:
        """Look at its process."""
        return not_ordered(found, verb)

    def log_query(self, name: str, lines: int) -> Query:
        """Ask Docker."""
        return Query(command=sh("docker", "logs", "--tail", str(lines), name) + " 2>&1")


def _create_and_start(name: str, want: ContainerParams) -> tuple[Command, ...]:
    return (*creation(name, want), start(name))


def _replacement(name: str, want: ContainerParams, found: State, cause: str) -> Change:
    commands = (*_stop_and_remove(name, found), *_create_and_start(name, want))
    return Change(action=Action.REPLACE, cause=cause, before=found, commands=commands)


def _stop_and_remove(name: str, state: State) -> tuple[Command, ...]:
    grace = float(state.get("stop_grace", 10))
    return (*end_process(string(state.get("unstarted"))), stop(name, grace), remove(name))


def _parse_one(
    item: Mapping[str, Any], limits: Mapping[str, Mapping[str, str]], builds: Collection[str]
) -> Observed | None:  # fmt: skip
    labels = string_map(item.get("Labels"))
    if labels.get(INSTANCE) == BUILD:
        return left_by_build(item, _state_of(item, {}), builds)
    if not (instance := instance_of(item)):
        return None
    state = {**_state_of(item, labels), "limits": limits.get(string(item.get("Id")), {})}
    name = container_name(instance, labels.get(SERVICE, ""))
    return Observed(module="container", name=name, instance=instance, state=state)


def _state_of(item: Mapping[str, Any], labels: Mapping[str, str]) -> dict[str, Any]:
    status = string(item.get("Status"))
    exited, health = _EXITED.match(status), _HEALTH.search(status)
    return {
        "service": labels.get(SERVICE, ""),
        "source": labels.get(SOURCE, ""),
        "hash": labels.get(CONFIG_HASH, ""),
        "taken": labels.get(TAKEN, "").split(),
        "parts": dict(part.split("=", 1) for part in labels.get(CONFIG_PARTS, "").split(",") if "=" in part),
        "stop_grace": integer(labels.get(STOP_GRACE, "10"), high=_LONGEST_GRACE_S, default=10),
        "image": string(item.get("Image")),
        "id": string(item.get("Id"))[:12],
        "unstarted": string(item.get("Id"))[:12] if item.get("State") == "created" else "",
        "state": state if _STATE.fullmatch(state := string(item.get("State"))) else "",
        "status": status,
        "exit_code": int(exited.group(1)) if exited else None,
        "health": health.group(1).replace("health: ", "") if health else "",
        "addresses": _ends(item.get("NetworkSettings"), "IPAddress"),
        "network_ids": _ends(item.get("NetworkSettings"), "NetworkID"),
    }


def _ends(settings: object, key: str) -> dict[str, str]:
    """Return network -> one value of the container's end there; a stopped container's has no address."""
    networks = settings.get("Networks") if isinstance(settings, Mapping) else None
    if not isinstance(networks, Mapping):
        return {}
    return {str(name): string(end.get(key)) for name, end in networks.items() if isinstance(end, Mapping)}


def _wrong_address(want: ContainerParams, found: State) -> str:
    """Return why a running container cannot be reached: no network, or not the address that its peers' tables have."""
    network = want.network
    if network.mode != "overlay" or found["state"] != "running":
        return ""
    address = found["addresses"].get(network.name)
    if address is None:
        return f"not attached to network {network.name}"
    return "" if address == network.ip else f"address is {address or 'none'}, not {network.ip}"


_MEANT_TO_END = " (meant to end? `job: true`)"


def _check_process(name: str, want: ContainerParams, found: State) -> Change | None:
    job, state, code = want.job, found["state"], found["exit_code"]
    if state == "running" or (job and state == "exited" and code == 0):
        return None
    causes = {
        "paused": "paused",
        "restarting": "keeps restarting",
        "exited": f"{'job ' if job else ''}exited with code {code}{_MEANT_TO_END * (code == 0)}",
    }
    verb = {"paused": "unpause", "restarting": "restart"}.get(state, "start")
    command = EngineCall(method="POST", path=f"/containers/{name}/{verb}")
    cause = causes.get(state, f"state is {state or 'unknown'}")
    return Change(action=Action.UPDATE, cause=cause, before=found, commands=(*looks(name, want), command))
