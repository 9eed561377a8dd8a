"""What an experiment asks for beyond its own containers, named so that a user can allow it or not.

An EDF may come from a stranger. Everything that reaches the robot itself is a `Permission`; `plan` lists them,
`apply` refuses those whose kind is not allowed. Pure.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from types import MappingProxyType

import msgspec

from srprov.codes import Code
from srprov.definitions.containermodel import ContainerDefinition, Port, Runtime
from srprov.definitions.model import Experiment, NetworkSettings, Service
from srprov.errors import RefusedError
from srprov.image_reference import parse_reference
from srprov.modules.mount_kind import GRAVE, below, holds_data, mount_kind, written_by
from srprov.network.identity import VNI_FIRST, is_for_overlays
from srprov.planning.graver import (
    AS_ROOT,
    ELSEWHERE,
    EVERY_PROCESS,
    LISTENERS,
    READ,
    SHARED,
    TOLD,
    WRITTEN,
    noted,
    of_capability,
    of_runtime,
    of_sysctl,
)
from srprov.planning.hardware import OTHERS, Places, of_hardware
from srprov.planning.image_origin import not_from_a_registry
from srprov.planning.log_options import of_logging
from srprov.planning.repositories import fetched, of_repositories
from srprov.planning.security_options import of_security

KINDS = (
    "privileged",
    "host-network",
    "host-pid",
    "host-ipc",
    "host-path",
    "docker-socket",
    *("device", "gpu"),
    "capability",
    "sysctl",
    "security-opt",
    "realtime",
    "low-port",
    "restart-always",
    "unit",
    *("runtime", "logging"),
    "built-image",
    "engine-fetch",
    "fetch",
    "git",
    "outside",
    "env",
    *("secret", "secret-command"),
    "playbook",
)
ASKED_FIRST = ("git", "outside", "env", "secret", "secret-command", "playbook")
"""Kinds that `plan` must not serve without permission either: to plan is to fetch, read, render or ask for it."""
_REALTIME = ("memlock", "nice", "rtprio", "rttime")
"""Limits that take memory or the processor away from everything else on the robot."""
_FIRST_FREE_PORT = 1024
_READ_ONLY = "read-only, but for what is mounted below it"
"""Engines before 25, and kernels before 5.12, know no other way."""
_NONE: Mapping[str, ContainerDefinition] = MappingProxyType({})


class Permission(msgspec.Struct, frozen=True, kw_only=True):
    """Something in the experiment that reaches beyond its containers."""

    kind: str
    service: str
    what: str


def permissions(
    experiment: Experiment, containers: Mapping[str, ContainerDefinition] = _NONE
) -> tuple[Permission, ...]:
    """List what the experiment and its CDFs ask for, sorted by kind and service; playbooks last, in their order."""
    written = _written(experiment)
    found = [one for service in experiment.services.values() for one in _of_service(service, written)]
    found += [one for service in experiment.services.values() for one in of_image(service, containers)]
    for service in experiment.services.values():
        asked = of_repositories(containers.get(service.cdf))
        found += [Permission(kind="git", service=service.name, what=what) for what in asked]
    for name, url, ref in experiment.remote:
        what = fetched(url, ref, "a CDF in it says what the container is")
        found.append(Permission(kind="git", service=name, what=what))
    found += _of_network(experiment.network)
    for service in experiment.services.values():
        for use in service.secrets:
            # whoever writes an EDF could name any variable, file or program of the controller
            source = experiment.secrets[use.source]
            found.append(Permission(kind=source.kind, service=service.name, what=f"{use.source}, from {source.origin}"))
    urls = {mount.url for one in experiment.services.values() for mount in one.runtime.mounts if mount.url}
    found += (fetch(url) for url in urls)
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


def fetch(url: str) -> Permission:
    """Return what it takes to download a data set on this machine, from its own network."""
    return Permission(kind="fetch", service="data sets", what=f"{url}, downloaded by this machine")


def refused(asked: Collection[Permission], allowed: Collection[str]) -> tuple[Permission, ...]:
    """Return those that are not allowed; the word `all` allows every kind."""
    return () if "all" in allowed else tuple(one for one in asked if one.kind not in allowed)


def require(asked: Collection[Permission], allowed: Collection[str], instead: str = "") -> None:
    """Refuse what is not allowed; `instead` is what else there is to do.

    Raises:
        RefusedError: Names all of it, and the flags that would allow it.
    """
    missing = refused(asked, allowed)
    if missing:
        what = "; ".join(f"{one.service}: {one.kind} ({one.what})" for one in missing)
        flags = " ".join(f"--allow {kind}" for kind in sorted({one.kind for one in missing}))
        raise RefusedError(
            f"the experiment asks for more than its own containers: {what}",
            hint="; ".join(filter(None, (f"if you trust it: {flags}", instead))),
            code=Code.NOT_ALLOWED,
        )


def _of_network(settings: NetworkSettings) -> Iterator[Permission]:
    """Yield what the overlay takes from the robots' own network: their containers would have its addresses, or port."""
    if settings.subnet is not None and not is_for_overlays(settings.subnet):
        what = f"{settings.subnet} leads into the overlay on every robot, not to who has these addresses outside"
        yield Permission(kind="host-network", service="network.subnet", what=noted(what, ELSEWHERE))
    if settings.vni is not None and settings.vni < VNI_FIRST:
        what = f"{settings.vni} may be the VNI of an overlay that a robot does not show, such as Docker Swarm's"
        yield Permission(kind="host-network", service="network.vni", what=what)
    if settings.port < _FIRST_FREE_PORT:
        yield Permission(kind="low-port", service="network.port", what=f"{settings.port}/udp, on every robot")
    if settings.persist:
        what = "a unit of systemd on every robot makes the overlay's link when it boots, as root"
        yield Permission(kind="unit", service="network.persist", what=what)


def _written(experiment: Experiment) -> Places:
    """Return what tells whether containers of the experiment may write to a robot's path: it is what these want."""
    return below(path for service in experiment.services.values() for path in written_by(service.runtime))


def _of_service(service: Service, written: Places) -> Iterator[Permission]:
    run = service.runtime
    if service.network in ("host", "both"):
        yield Permission(kind="host-network", service=service.name, what=noted("the robot's network", LISTENERS))
    own = _namespaces(run, shared=service.network in ("host", "both") or run.ipc == "host")
    for kind, what in (*own, *_paths(run, written), *of_hardware(run, written), *_lasting(run)):
        yield Permission(kind=kind, service=service.name, what=what)


def of_image(service: Service, containers: Mapping[str, ContainerDefinition]) -> Iterator[Permission]:
    """Yield what a service's image, or the build of it, asks of an engine; `containers` has CDFs by their keys."""
    cdf = containers.get(service.cdf)
    for name in (service.image,) if service.image else cdf.images if cdf else ():
        if why := not_from_a_registry(name):
            yield Permission(kind="built-image", service=service.name, what=f"{name}: {why}")
        elif parse_reference(name).is_private:
            what = f"{name}: the robot's engine asks whoever that is in the robot's own network"
            yield Permission(kind="engine-fetch", service=service.name, what=noted(what, TOLD))
    for source in cdf.fetches if cdf else ():
        what = f"ADD {source}: the robot's engine fetches it, from the robot's own network"
        if source.startswith("FROM "):
            what = f"{source}: which ONBUILD instructions run then is not known"
        yield Permission(kind="engine-fetch", service=service.name, what=noted(what, TOLD))


def _namespaces(run: Runtime, *, shared: bool) -> Iterator[tuple[str, str]]:
    if run.privileged:
        yield "privileged", noted("all devices and capabilities of the robot", AS_ROOT)
    if run.pid:
        yield "host-pid", noted(f"pid: {run.pid}", EVERY_PROCESS)
    if run.ipc and run.ipc not in ("private", "none"):
        yield "host-ipc", noted(f"ipc: {run.ipc}", SHARED if run.ipc == "host" else "")
    for capability in run.cap_add:
        yield "capability", noted(capability, of_capability(capability))
    for name, value in sorted(run.sysctls.items()):
        yield "sysctl", noted(f"{name}={value}", of_sysctl(name, shared=shared))
    yield from of_security(run.security_opt)
    if run.runtime:
        what = f"runtime: {run.runtime}, which starts its container instead of the engine's own"
        yield "runtime", noted(what, of_runtime(run.runtime))


def _paths(run: Runtime, written: Places) -> Iterator[tuple[str, str]]:
    for mount in run.mounts:
        if mount.kind == "bind":
            kind, why = mount_kind(mount.source, read_only=mount.read_only)
            if kind != GRAVE and written(mount.source):
                kind, why = GRAVE, f"{OTHERS}: a link there leads anywhere"
            made = "made where it is not there" if mount.create_host_path else ""
            if kind == GRAVE:
                why = f"{AS_ROOT}: {why}".removesuffix(": ")
            elif not why and (not mount.read_only or holds_data(mount.source)):
                why = READ if mount.read_only else WRITTEN
            notes = [note for note in (_READ_ONLY if mount.read_only else "", made, why) if note]
            yield kind, noted(mount.source, "; ".join(notes))


def _lasting(run: Runtime) -> Iterator[tuple[str, str]]:
    """Return what others on the robot feel: its processor and memory, its well-known ports, its next boot."""
    for name, soft, hard in run.ulimits:
        if name in _REALTIME:
            yield "realtime", f"ulimit {name}={soft}:{hard}"
    if run.oom_score_adj < 0:
        yield "realtime", f"oom_score_adj: {run.oom_score_adj}, when memory is short others are killed first"
    yield from (("low-port", what) for what in _low_ports(run.ports))
    yield from (("logging", what) for what in of_logging(run.logging))
    if run.restart not in ("", "no"):  # Docker starts on-failure:N too: a container that the boot ended has failed
        yield "restart-always", f"restart: {run.restart}, also when the robot boots after the experiment"


def _low_ports(ports: Collection[Port]) -> Iterator[str]:
    """Return published ports below 1024, neighbours as one range."""
    low = sorted({(protocol, published) for _, published, _, protocol in ports if published < _FIRST_FREE_PORT})
    first = 0
    for index, (protocol, published) in enumerate(low):
        if low[index + 1 : index + 2] != [(protocol, published + 1)]:
            start = low[first][1]
            yield f"{start if start == published else f'{start}-{published}'}/{protocol}"
            first = index + 1
