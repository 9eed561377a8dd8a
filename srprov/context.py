"""What the playbooks are rendered with: one plain-value context per robot.

Takes the experiment, its CDFs, where services run, the overlay, the image plans and all robots as they are; gives
for every robot that has a part in it a context and the blobs that it names. Reads the files that services mount,
and nothing else.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from srprov.definitions.model import Experiment, Mount, Runtime, Service
from srprov.facts.model import HostFacts, Snapshot
from srprov.images.reference import Reference, parse_reference
from srprov.modules.container import container_name
from srprov.modules.module import STATE_ROOT, canonical
from srprov.modules.network import network_hash
from srprov.modules.secret import secret_path
from srprov.network.hosts import hosts_file
from srprov.network.layout import Overlay
from srprov.resource import resource_id

if TYPE_CHECKING:
    from srprov.images.plan import ImagePlan

_WITNESSES = 2
"""Robots without a service that keep the placement record."""
_FLOOD = "00:00:00:00:00:00"


@dataclasses.dataclass(frozen=True, kw_only=True, slots=True)
class RenderInputs:
    """Everything that contexts are made of."""

    instance: str
    source: str
    experiment: Experiment
    placed: Mapping[str, str]
    overlay: Overlay
    images: Mapping[str, ImagePlan]
    """CDF key -> what is built for it; only for CDFs that need a build."""
    references: Mapping[str, str]
    """CDF key -> ready image, for CDFs that name one."""
    record: Mapping[str, Any]
    """The placement record that every robot gets."""
    snapshot: Snapshot


def contexts(parts: RenderInputs) -> tuple[dict[str, dict[str, Any]], dict[str, bytes]]:
    """Return robot -> context, for reachable robots with a part in the experiment, and all blobs by sha256."""
    blobs: dict[str, bytes] = {}
    trees = {mount.source: _tree(mount.source, blobs) for mount in _mounts(parts, "tree")}
    images = _images(parts, blobs)
    members = {robot for robot in parts.placed.values() if robot in parts.snapshot.facts}
    hosts = members | set(images) | set(_witnesses(parts, members))
    return {host: _one(parts, host, images.get(host, []), trees) for host in sorted(hosts)}, blobs


def _witnesses(parts: RenderInputs, members: Collection[str]) -> list[str]:
    """Return robots beyond the members that keep the placement record too.

    When all members are out of reach, they are who knows that services may still run there. Those that keep it already
    go on doing so; then names decide.
    """
    path = _record_path(parts.instance)
    keepers = {host for host, items in parts.snapshot.observed.items() if any(item.name == path for item in items)}
    others = [host for host, facts in parts.snapshot.facts.items() if host not in members and facts.docker is not None]
    return sorted(others, key=lambda host: (host not in keepers, host))[:_WITNESSES]


def _record_path(instance: str) -> str:
    return f"{STATE_ROOT}/{instance}/placement.json"


def _tree(path: str, blobs: dict[str, bytes]) -> dict[str, str]:
    from srprov.disk import tree_tar

    blob = tree_tar(path)
    digest = hashlib.sha256(blob).hexdigest()
    blobs[digest] = blob
    return {"blob": digest, "top": Path(path).name}


def _one(
    parts: RenderInputs, host: str, images: Sequence[Mapping[str, Any]], trees: Mapping[str, Mapping[str, str]]
) -> dict[str, Any]:
    services = [parts.experiment.services[name] for name, robot in sorted(parts.placed.items()) if robot == host]
    overlay = _overlay(parts.overlay, host)
    facts = parts.snapshot.facts[host]
    used = {mount.source for service in services for mount in service.runtime.mounts if mount.kind == "tree"}
    volumes = {m.source for service in services for m in service.runtime.mounts if m.kind == "volume"}
    return {
        "host": host,
        "folder": f"{STATE_ROOT}/{parts.instance}",
        "robot": _robot(facts),
        "instance": parts.instance,
        "source": parts.source,
        "api": facts.docker.api_version if facts.docker else "1.41",
        "overlay": overlay,
        "images": list(images),
        "files": _files(parts, member=bool(services)),
        "trees": [
            {"path": _tree_path(parts.instance, trees[source]), "blob": trees[source]["blob"]}
            for source in sorted(used)
        ],
        "volumes": [_volume_name(parts.instance, name) for name in sorted(volumes)],
        "secrets": _secrets(parts.instance, services),
        "services": [_service(parts, service, overlay, trees) for service in services],
    }


def _robot(facts: HostFacts) -> dict[str, Any]:
    """Return what users' playbooks may decide by: facts that do not change by themselves."""
    lasting = {"arch": facts.arch, "cpus": facts.cpus, "memory": facts.memory_total, "kernel": facts.kernel}
    return {**lasting, "os": facts.os, "tags": list(facts.tags), "devices": list(facts.devices)}


def _files(parts: RenderInputs, *, member: bool) -> list[dict[str, Any]]:
    """Return the record of the whole placement, and for a robot that runs something the hosts file."""
    path, content = _record_path(parts.instance), canonical(parts.record) + "\n"
    record = {"path": path, "content": content, "mode": "0644", "in_place": False}
    hosts = f"{STATE_ROOT}/{parts.instance}/hosts"
    names = {"path": hosts, "content": hosts_file(parts.overlay), "mode": "0644", "in_place": True}
    return [names, record] if member else [record]


def _secrets(instance: str, services: Sequence[Service]) -> list[dict[str, str]]:
    """Return the secrets of a robot's services: names and places, never values."""
    wanted = {(use.source, use.mode) for service in services for use in service.secrets}
    return [{"path": secret_path(instance, name, mode), "name": name, "mode": mode} for name, mode in sorted(wanted)]


def _overlay(overlay: Overlay, host: str) -> dict[str, Any] | None:
    if host not in overlay.vteps:
        return None
    fdb = [[_FLOOD, vtep] for vtep in overlay.flood[host]] + [list(entry) for entry in overlay.fdb[host]]
    return {
        "network": overlay.network,
        "bridge": overlay.bridge,
        "link": overlay.link,
        "subnet": str(overlay.subnet),
        "gateway": str(overlay.gateways[host]),
        "mtu": overlay.mtu,
        "vni": overlay.vni,
        "port": overlay.port,
        "vtep": overlay.vteps[host],
        "fdb": sorted(fdb),
    }


def _service(
    parts: RenderInputs, service: Service, overlay: Mapping[str, Any] | None, trees: Mapping[str, Mapping[str, str]]
) -> dict[str, Any]:
    image = image_of(parts, service)
    mounts = [_mount(parts.instance, mount, trees) for mount in service.runtime.mounts]
    needs: list[Any] = [f"image:{image}"]
    for use in service.secrets:
        place = secret_path(parts.instance, use.source, use.mode)
        mounts.append({"Type": "bind", "Source": place, "Target": use.target, "ReadOnly": True})
        needs.append(f"secret:{place}")
    if service.network != "none":
        hosts = f"{STATE_ROOT}/{parts.instance}/hosts"
        mounts.append({"Type": "bind", "Source": hosts, "Target": "/etc/hosts", "ReadOnly": True})
        needs.append(f"file:{hosts}")
    if service.network == "overlay" and overlay:
        needs += [f"network:{overlay['network']}", f"vxlan:{overlay['link']}"]
    needs += [f"tree:{_tree_path(parts.instance, trees[m.source])}" for m in service.runtime.mounts if m.kind == "tree"]
    needs += [f"volume:{_volume_name(parts.instance, m.source)}" for m in service.runtime.mounts if m.kind == "volume"]
    needs += [_dependency(parts, other, condition) for other, condition in sorted(service.depends_on.items())]
    return {
        "name": service.name,
        "container": container_name(parts.instance, service.name),
        "image": image,
        # Docker refuses a hostname beside the host's network
        "hostname": "" if service.network == "host" else service.name,
        "job": service.runtime.job,
        "run": _run(service.runtime),
        "mounts": mounts,
        "network": _network(parts, service, overlay),
        "needs": needs,
    }


def _dependency(parts: RenderInputs, other: str, condition: str) -> dict[str, str]:
    name = container_name(parts.instance, other)
    return {"id": resource_id(parts.placed[other], "container", name), "condition": condition}


def _network(parts: RenderInputs, service: Service, overlay: Mapping[str, Any] | None) -> dict[str, str]:
    if service.network != "overlay" or not overlay:
        return {"mode": service.network}
    return {
        "mode": "overlay",
        "name": overlay["network"],
        "ip": str(parts.overlay.addresses[service.name]),
        "mac": parts.overlay.macs[service.name],
        "hash": network_hash(overlay),
    }


def _run(runtime: Runtime) -> dict[str, Any]:
    """Return the run-time fields as JSON values; mounts are given apart, in the engine's form."""
    plain = {
        field.name: getattr(runtime, field.name)
        for field in dataclasses.fields(runtime)
        if field.name not in ("mounts", "healthcheck", "environment", "sysctls")
    }
    check = runtime.healthcheck
    return {
        **plain,
        "environment": dict(runtime.environment),
        "sysctls": dict(runtime.sysctls),
        "healthcheck": dataclasses.asdict(check) if check else None,
    }


def _mount(instance: str, mount: Mount, trees: Mapping[str, Mapping[str, str]]) -> dict[str, Any]:
    if mount.kind == "tmpfs":
        return {"Type": "tmpfs", "Target": mount.target}
    if mount.kind == "volume":
        source = {"Type": "volume", "Source": _volume_name(instance, mount.source)}
    elif mount.kind == "tree":
        tree = trees[mount.source]
        source = {"Type": "bind", "Source": f"{_tree_path(instance, tree)}/{tree['top']}"}
    else:
        source = {"Type": "bind", "Source": mount.source}
    # shipped files are the experiment's own text: a container that wrote to them would make two robots differ
    return {**source, "Target": mount.target, "ReadOnly": mount.read_only or mount.kind == "tree"}


def _mounts(parts: RenderInputs, kind: str) -> list[Mount]:
    return [m for service in parts.experiment.services.values() for m in service.runtime.mounts if m.kind == kind]


def _tree_path(instance: str, tree: Mapping[str, str]) -> str:
    return f"{STATE_ROOT}/{instance}/trees/{tree['blob'][:24]}"


def _volume_name(instance: str, name: str) -> str:
    return f"srprov.{instance}.{name}"


def normalise(text: str) -> str:
    """Return an image's name as Docker lists it: `busybox` is `busybox:latest`; beside a digest a tag says nothing."""
    reference = parse_reference(text)
    tag = "" if reference.digest else reference.tag
    return Reference(reference.domain, reference.path, tag, reference.digest).familiar


def image_of(parts: RenderInputs, service: Service) -> str:
    """Return image that a service runs: the one it names, the one its CDF names, or the content tag of its build."""
    if service.image:
        return normalise(service.image)
    if service.cdf in parts.images:
        return parts.images[service.cdf].tag
    return normalise(parts.references[service.cdf])


def _images(parts: RenderInputs, blobs: dict[str, bytes]) -> dict[str, list[dict[str, Any]]]:
    """Return robot -> its images; one to build comes from a robot that has it, else the first of its architecture."""
    wanted: dict[str, dict[str, dict[str, Any]]] = {}
    present = {(h, e.name) for h, items in parts.snapshot.observed.items() for e in items if e.module == "image"}
    plans = {plan.tag: plan for plan in parts.images.values()}
    for name, host in sorted(parts.placed.items()):
        facts = parts.snapshot.facts.get(host)
        if facts is None:
            continue
        image = image_of(parts, parts.experiment.services[name])
        if image not in plans:
            wanted.setdefault(host, {})[image] = {"name": image, "source": "pull", "needs": []}
            continue
        if (host, image) in present:
            wanted.setdefault(host, {}).setdefault(image, _copied(image, host))
            continue
        holder = next((h for h in _alike(parts.snapshot, facts) if (h, image) in present), None)
        builder = holder or _alike(parts.snapshot, facts)[0]
        if holder is None:
            plan = plans[image]
            digest = hashlib.sha256(plan.context).hexdigest()
            blobs[digest] = plan.context
            build = {"name": image, "source": "build", "blob": digest, "unpinned": not plan.pinned, "needs": []}
            wanted.setdefault(builder, {})[image] = build
        if builder != host:
            wanted.setdefault(host, {})[image] = _copied(image, builder)
    return {host: [images[name] for name in sorted(images)] for host, images in wanted.items()}


def _copied(image: str, source: str) -> dict[str, Any]:
    return {"name": image, "source": "copy", "from": source, "needs": [resource_id(source, "image", image)]}


def _alike(snapshot: Snapshot, facts: HostFacts) -> list[str]:
    """Return the reachable robots of the same architecture with an engine, in name order."""
    return sorted(h for h, other in snapshot.facts.items() if other.arch == facts.arch and other.docker is not None)
