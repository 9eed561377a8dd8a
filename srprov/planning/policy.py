"""What an experiment asks for beyond its own containers, named so that a user can allow it or not.

An EDF may come from a stranger. Everything that reaches the robot itself is a `Permission`; `plan` lists them,
`apply` refuses those whose kind is not allowed. Pure.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass

from srprov.definitions.containermodel import Runtime
from srprov.definitions.model import Experiment, Service
from srprov.errors import RefusedError

KINDS = (
    "privileged",
    "host-network",
    "host-pid",
    "host-ipc",
    "host-path",
    "docker-socket",
    "device",
    "gpu",
    "capability",
    "sysctl",
    "security-opt",
    "outside",
    "env",
    "secret",
    "playbook",
)
ASKED_FIRST = ("outside", "env", "secret", "playbook")
"""Kinds that `plan` must not serve without permission either: to plan is to read, render or ask what they say."""
_SOCKETS = ("/var/run/docker.sock", "/run/docker.sock")


@dataclass(frozen=True, kw_only=True, slots=True)
class Permission:
    """Something in the experiment that reaches beyond its containers."""

    kind: str
    service: str
    what: str


def permissions(experiment: Experiment) -> tuple[Permission, ...]:
    """List what the experiment asks for, sorted by kind and service; playbooks last, in their order."""
    found = [one for service in experiment.services.values() for one in _of_service(service)]
    for service in experiment.services.values():
        for use in service.secrets:
            # whoever writes an EDF could name any variable, file or program of the controller
            what = f"{use.source}, from {experiment.secrets[use.source].origin}"
            found.append(Permission(kind="secret", service=service.name, what=what))
    # what leaves the controller lies in the experiment's folder, or is named here
    found += (Permission(kind="outside", service=service, what=path) for service, path in experiment.outside)
    taken = ((service, f"{name}, from the controller's environment") for service, name in experiment.environment)
    found += (Permission(kind="env", service=service, what=what) for service, what in taken)
    listed = sorted(found, key=lambda one: (KINDS.index(one.kind), one.service, one.what))
    for playbook in experiment.playbooks:
        # a playbook may state anything, as root: no list of modules would make one from a stranger harmless
        listed.append(Permission(kind="playbook", service=playbook.name, what="states anything on the robots, as root"))
        for command in playbook.commands:
            listed.append(Permission(kind="playbook", service=f"{playbook.name}:{command.line}", what=command.what))
    return tuple(listed)


def refused(asked: Collection[Permission], allowed: Collection[str]) -> tuple[Permission, ...]:
    """Return those that are not allowed; the word `all` allows every kind."""
    return () if "all" in allowed else tuple(one for one in asked if one.kind not in allowed)


def require(asked: Collection[Permission], allowed: Collection[str]) -> None:
    """Refuse what is not allowed.

    Raises:
        RefusedError: Names all of it, and the flags that would allow it.
    """
    missing = refused(asked, allowed)
    if missing:
        what = "; ".join(f"{one.service}: {one.kind} ({one.what})" for one in missing)
        flags = " ".join(f"--allow {kind}" for kind in sorted({one.kind for one in missing}))
        raise RefusedError(
            f"the experiment asks for more than its own containers: {what}", hint=f"if you trust it: {flags}"
        )


def _of_service(service: Service) -> Iterator[Permission]:
    run = service.runtime
    if service.network in ("host", "both"):
        yield Permission(kind="host-network", service=service.name, what="the robot's network")
    for kind, what in (*_namespaces(run), *_paths(run), *_hardware(run)):
        yield Permission(kind=kind, service=service.name, what=what)


def _namespaces(run: Runtime) -> Iterator[tuple[str, str]]:
    if run.privileged:
        yield "privileged", "all devices and capabilities of the robot"
    if run.pid:
        yield "host-pid", f"pid: {run.pid}"
    if run.ipc and run.ipc not in ("private", "none"):
        yield "host-ipc", f"ipc: {run.ipc}"
    for capability in run.cap_add:
        yield "capability", capability
    for name, value in sorted(run.sysctls.items()):
        yield "sysctl", f"{name}={value}"
    for option in run.security_opt:
        yield "security-opt", option


def _paths(run: Runtime) -> Iterator[tuple[str, str]]:
    for mount in run.mounts:
        if mount.kind == "bind":
            kind = "docker-socket" if mount.source in _SOCKETS else "host-path"
            yield kind, f"{mount.source}{' (read-only)' if mount.read_only else ''}"


def _hardware(run: Runtime) -> Iterator[tuple[str, str]]:
    for path, _, rights in run.devices:
        yield "device", f"{path} ({rights})"
    for rule in run.device_cgroup_rules:
        yield "device", f"cgroup rule {rule}"
    if run.gpus:
        yield "gpu", f"gpus: {run.gpus}"
