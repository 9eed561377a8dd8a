"""`deploy`, `platform` and replicas of a Compose service: which robots, how many, within which limits. Pure."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from srprov import names
from srprov.conversion.fields import size_text
from srprov.conversion.names_used import replicas
from srprov.conversion.project import Project
from srprov.importing.position import Path

_Given = Mapping[str, Any]
_CONSTRAINT = re.compile(r"(?P<what>[A-Za-z0-9_./-]+)\s*==(?P<value>.*)")
_ARCH = {"x86_64": "amd64", "amd64": "amd64", "aarch64": "arm64", "arm64": "arm64", "arm": "arm", "armv7l": "arm"}
_RESTART = {"none": "no", "any": "always", "on-failure": "on-failure"}


def placement(given: _Given, project: Project, at: Path, *, built: bool) -> dict[str, Any]:
    """Return `robot`, `requires`, `replicas`, `per_robot` and `job`."""
    deploy = given.get("deploy") or {}
    found: dict[str, Any] = {"robot": project.machine.robot} if project.machine.robot else {}
    tags: list[str] = []
    arch = {} if built else _platform(given, project, at)
    path = (*at, "deploy", "placement", "constraints")
    for one in (deploy.get("placement") or {}).get("constraints") or ():
        match = _CONSTRAINT.fullmatch(str(one).strip())
        what, value = (match["what"], match["value"].strip()) if match else ("", "")
        if what == "node.hostname" and names.valid("robot", value) and found.get("robot", value) == value:
            found["robot"] = value
            project.notes.adapted(path, f"'{value}' is the robot of that name in the inventory")
        elif what.startswith("node.labels."):
            label = what.removeprefix("node.labels.")
            tags.append(label if value in ("true", "1", "yes", "") else value)
            project.notes.adapted(path, f"robots with the tag '{tags[-1]}'", "srprov_tags of the inventory")
        elif what == "node.platform.arch" and value in _ARCH:
            arch = {"arch": [_ARCH[value]]}
            project.notes.adapted(path, f"robots of the architecture {_ARCH[value]}")
        else:
            project.notes.dropped(path, f"'{str(one)[:80]}' says nothing of a robot", "see `requires` and `robot`")
    requires = {**({"tags": tags} if tags else {}), **arch}
    pinned = "robot" in found
    return found | ({"requires": requires} if requires else {}) | _number(given, deploy, project, at, pinned=pinned)


def _platform(given: _Given, project: Project, at: Path) -> dict[str, Any]:
    written = given.get("platform")
    if not written:
        return {}
    arch = _ARCH.get(str(written).removeprefix("linux/").partition("/")[0])
    if arch is None:
        project.notes.refused((*at, "platform"), f"no robot is '{str(written)[:60]}'", "known: amd64, arm64 and arm")
        return {}
    return {"arch": [arch]}


def _number(given: _Given, deploy: _Given, project: Project, at: Path, *, pinned: bool) -> dict[str, Any]:
    mode, path = str(deploy.get("mode") or "replicated"), (*at, "deploy", "mode")
    found: dict[str, Any] = {"job": True} if mode.endswith("-job") else {}
    if mode.startswith("global"):
        if not pinned:
            project.notes.adapted(path, "one on each robot")
            return found | {"per_robot": {"tags": []}}
        project.notes.adapted(path, "one, as its robot is named")
    elif mode.endswith("-job"):
        project.notes.adapted(path, "a job: having ended with 0 is right")
    count = replicas(given)
    return found | ({"replicas": count} if count != 1 else {})


def resources(given: _Given, project: Project, at: Path) -> dict[str, Any]:
    """Return the limits and the restart policy that `deploy` gives; the service's own fields win."""
    deploy = given.get("deploy") or {}
    limits = (deploy.get("resources") or {}).get("limits") or {}
    reserved = (deploy.get("resources") or {}).get("reservations") or {}
    found: dict[str, Any] = {}
    if limits.get("cpus"):
        found["cpus"] = float(limits["cpus"])
    if limits.get("memory"):
        found["mem_limit"] = size_text(int(limits["memory"]))
    if int(limits.get("pids") or 0) > 0:
        found["pids_limit"] = int(limits["pids"])
    if reserved.get("memory"):
        found["mem_reservation"] = size_text(int(reserved["memory"]))
    return found | _restart(given, deploy, project, at)


def _restart(given: _Given, deploy: _Given, project: Project, at: Path) -> dict[str, Any]:
    policy = deploy.get("restart_policy")
    if not policy:
        return {}
    path = (*at, "deploy", "restart_policy")
    if given.get("restart"):
        for key in policy:
            project.notes.dropped((*path, key), "'restart' says it already")
        return {}
    word = _RESTART.get(str(policy.get("condition") or "any"), "always")
    times = int(policy.get("max_attempts") or 0)
    if times and word != "on-failure":
        project.notes.dropped((*path, "max_attempts"), "an engine counts attempts after failures only")
    return {"restart": f"{word}:{times}" if times and word == "on-failure" else word}
