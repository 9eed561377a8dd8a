"""One service of an experiment as one of a stack for Docker Swarm. Pure."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from typing import Any

import msgspec

from srprov.definitions.containermodel import EVERYWHERE, Mount, Runtime
from srprov.definitions.model import Experiment, Service
from srprov.exporting import cluster
from srprov.exporting.model import ADAPTED, DROPPED, REFUSED, File, Need, Part, Remark
from srprov.exporting.mounts import volume
from srprov.exporting.runtime import runtime_document
from srprov.exporting.swarm_classes import CANNOT
from srprov.exporting.wanted import Wanted
from srprov.network.discovery import FOLDER
from srprov.network.model import Overlay

_CONFIG_LIMIT = 500_000
"""Bytes that a config of Swarm holds: the store's limit in all versions."""
_CONFIG_DIGITS = 31
"""Of a hash. A config's name has 64 letters at most, with the stack's, which has up to 32, and a `_` before it."""
_OWN = (
    "restart",
    "mem_limit",
    "memswap_limit",
    "mem_reservation",
    "cpus",
    "pids_limit",
    "shm_size",
    "pull_policy",
    "deploy",
)
"""Keys of Compose that a stack says in other words, or not at all."""
_UNITS = {"": 1, "k": 1 << 10, "m": 1 << 20, "g": 1 << 30}


class Stack(msgspec.Struct, frozen=True, kw_only=True):
    """What the services of a stack have in common."""

    wanted: Wanted
    experiment: Experiment
    """With the discovery that Swarm's network can do."""
    overlay: Overlay
    images: Mapping[str, str]
    """CDF's key -> its image."""
    addresses: Mapping[str, str]
    """Service on its robot's own network -> the robot's address, for services of the overlay."""

    def part(self, service: Service) -> Part:
        """Return a service, its configs, and what is to be said of it."""
        run = service.runtime
        found = cluster.discovery(self.experiment, self.overlay, service)
        mounts = [self._mount(service, mount) for mount in run.mounts]
        told = [self._config(f"{FOLDER}/{name}", text.encode()) for name, text in found.files.items()]
        parts = [*mounts, *told]
        document = {
            "image": service.image or self.images[service.cdf],
            **{key: value for key, value in runtime_document(run).items() if key not in {*_OWN, *CANNOT}},
            **self._network(service),
            "environment": self._environment({**found.environment, **run.environment}),
            "volumes": [*_each(parts, "volume"), *_shared_memory(run)],
            "configs": _each(parts, "config"),
            "secrets": [
                {"source": use.source, "target": use.target, "mode": int(use.mode, 8)} for use in service.secrets
            ],
            "deploy": self._deploy(service),
        }
        if service.network == "host":
            document["sysctls"] = {name: one for name, one in run.sysctls.items() if not name.startswith("net.")}
        keep = ("command", "entrypoint", "init")
        return Part(
            document={
                key: value for key, value in document.items()
                if (value and key not in keep) or (key in keep and value not in (None, [], ()))
            },
            files=tuple(file for one in parts for file in one.files),
            remarks=(*self._remarks(service), *(remark for one in parts for remark in one.remarks)),
            needs=tuple(_secrets(self.experiment, service)),
        )  # fmt: skip

    def _environment(self, whole: Mapping[str, str]) -> dict[str, str | None]:
        """Return variables; one without a value is that of whoever deploys."""
        taken = self.wanted.open.stands_for
        return {name: None if taken(one) else _literal(one) for name, one in sorted(whole.items())}

    def _network(self, service: Service) -> dict[str, Any]:
        if service.network == "host":
            return {"networks": {"host": {}}}
        hosts = {**self.addresses, **dict(service.runtime.extra_hosts)}
        also = [service.runtime.hostname, service.instance_of]
        aliases = sorted({name for name in also if name and name != service.name})
        ports = [
            {"target": inside, "published": published, "protocol": protocol, "mode": "host"}
            for _, published, inside, protocol in service.runtime.ports
        ]
        return {
            "hostname": service.runtime.hostname or service.name,
            "networks": {"default": {"aliases": aliases} if aliases else {}},
            **({"extra_hosts": [f"{name}:{address}" for name, address in hosts.items()]} if hosts else {}),
            **({"ports": ports} if ports else {}),
        }

    def _deploy(self, service: Service) -> dict[str, Any]:
        run = service.runtime
        limits = {
            **({"cpus": str(run.cpus)} if run.cpus else {}),
            **({"memory": str(run.mem_limit)} if run.mem_limit else {}),
            **({"pids": run.pids_limit} if run.pids_limit else {}),
        }
        kept = {"memory": str(run.mem_reservation)} if run.mem_reservation else {}
        resources = {**({"limits": limits} if limits else {}), **({"reservations": kept} if kept else {})}
        return {
            # an address of its own for each task: middleware tells its peers the address that it has
            "endpoint_mode": "dnsrr",
            "labels": {"srprov.instance": self.experiment.name},
            "placement": {"constraints": [f"node.hostname=={self.wanted.placed[service.name]}"]},
            "restart_policy": _restart(run.restart),
            **({"resources": resources} if resources else {}),
        }

    def _mount(self, service: Service, mount: Mount) -> Part:
        field = cluster.field_of(mount)
        if mount.kind == "tmpfs":
            size = cluster.tmpfs_size(mount)
            return Part(document={"volume": _tmpfs(mount.target, size[0] * _UNITS[size[1]] if size else None)})
        if mount.kind == "volume":
            return volume(service, mount, _long("volume", mount.source, mount))
        if mount.kind == "bind":
            refused = (
                "Swarm makes no folder: make it, and leave `create_host_path` out" if mount.create_host_path else ""
            )
            if mount.home_of:
                refused = f"where the home of '{mount.home_of}' is on its robot is not known here"
            said = (cluster.remark(service, field, REFUSED, refused),) if refused else ()
            return Part(document={"volume": _long("bind", mount.source, mount)}, remarks=said)
        try:
            files = cluster.shipped(self.wanted, mount, _CONFIG_LIMIT, "a config of Swarm")
        except cluster.CannotShip as cannot:
            return Part(remarks=(cluster.remark(service, field, REFUSED, str(cannot)),))
        made = [self._config(one.target, one.content, one.mode) for one in files]
        return Part(
            document={"configs": [one.document["config"] for one in made]},
            files=tuple(file for one in made for file in one.files),
        )

    def _config(self, target: str, content: bytes, mode: int = 0o444) -> Part:
        """Return a file as a config; its name changes with its content, as configs cannot change.

        With fewer bits, who writes an EDF finds two contents of one name, and one is mounted for the other.
        """
        name = hashlib.sha256(content).hexdigest()[:_CONFIG_DIGITS]
        return Part(
            document={"config": {"source": name, "target": target, "mode": mode}},
            files=(File(path=f"configs/{name}", content=content),),
        )

    def _remarks(self, service: Service) -> Iterator[Remark]:
        run = service.runtime
        yield from cluster.refusals(service, CANNOT)
        for address, published, _, _ in run.ports:
            if address not in EVERYWHERE:
                words = f"Swarm publishes port {published} on all addresses of its robot"
                yield cluster.remark(service, "ports", REFUSED, words)
        if run.extra_hosts and "host-gateway" in dict(run.extra_hosts).values():
            yield cluster.remark(service, "extra_hosts", REFUSED, "Swarm knows no `host-gateway`")
        if service.network == "host" and (lost := sorted(one for one in run.sysctls if one.startswith("net."))):
            words = f"the engine refuses {', '.join(lost)} in the robot's own network"
            yield cluster.remark(service, "sysctls", DROPPED, words)
        for name, value in sorted(run.environment.items()):
            if self.wanted.open.stands_for(value):
                words = f"{name} is taken from the environment of whoever deploys"
                yield cluster.remark(service, "environment", ADAPTED, words)


def _literal(text: str) -> str:
    """Return a text so that Swarm leaves it as it is: it takes those of variables and mounts for templates of Go."""
    return text.replace("{{", '{{"{{"}}')


def _each(parts: list[Part], key: str) -> list[object]:
    """Return what the parts have under a key, or as a list under its plural."""
    found: list[object] = []
    for one in parts:
        found += [one.document[key]] if key in one.document else []
        several: Any = one.document.get(f"{key}s", ())
        found += several
    return found


def _restart(policy: str) -> dict[str, Any]:
    name, _, times = policy.partition(":")
    condition = {"no": "none", "on-failure": "on-failure"}.get(name, "any")
    return {"condition": condition, **({"max_attempts": int(times)} if times else {})}


def _tmpfs(target: str, size: int | None) -> dict[str, Any]:
    return {"type": "tmpfs", "target": _literal(target), **({"tmpfs": {"size": size}} if size is not None else {})}


def _shared_memory(run: Runtime) -> list[dict[str, Any]]:
    return [_tmpfs("/dev/shm", run.shm_size)] if run.shm_size else []  # noqa: S108 - a path in the container


def _long(kind: str, source: str, mount: Mount) -> dict[str, Any]:
    found: dict[str, Any] = {"type": kind, "source": _literal(source), "target": _literal(mount.target)}
    return {**found, "read_only": True} if mount.read_only else found


def _secrets(experiment: Experiment, service: Service) -> Iterator[Need]:
    for use in service.secrets:
        name = own_name(experiment, use.source)
        yield Need(
            kind="secret", name=name, what=f"`docker secret create {name} FILE`, on a manager, before deploy.sh."
        )


def own_name(experiment: Experiment, name: str) -> str:
    """Return what a secret or a volume is called on the swarm.

    With `STACK_NAME`, as Docker has it, a stranger's experiment called `nav` would be given what a Compose project
    `nav` keeps on the robot, and secrets that somebody made for something else.
    """
    return f"srprov_{experiment.name}_{name}"
