"""What the playbooks are rendered with: one plain-value context per robot.

Takes the experiment, its CDFs, where services run, the overlay, the image plans and all robots as they are; gives
for every robot that has a part in it a context and the blobs that it names. Reads the files that services mount,
and nothing else.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from srprov.codes import Code
from srprov.controller.data_sets import data_set, used_data
from srprov.controller.render_inputs import RenderInputs
from srprov.controller.robot_files import RobotFiles
from srprov.controller.robot_images import robot_images
from srprov.controller.services import service_context, tree_path
from srprov.definitions.containermodel import Mount, Seed
from srprov.definitions.model import Service
from srprov.definitions.sharing import written
from srprov.errors import UsageError
from srprov.facts.model import HostFacts
from srprov.modules.module import STATE_ROOT
from srprov.modules.secret import secret_path
from srprov.modules.unit import unit_name
from srprov.modules.volume import volume_name
from srprov.network.model import Overlay, Tunnel

_WITNESSES = 2
"""Robots without a service that keep the placement record."""
_FLOOD = "00:00:00:00:00:00"


def contexts(inputs: RenderInputs) -> tuple[dict[str, dict[str, Any]], dict[str, bytes]]:
    """Return robot -> context, for reachable robots with a part in the experiment, and all blobs by sha256."""
    blobs: dict[str, bytes] = {}
    shipped = {mount.source for mount in _mounts(inputs, "tree")}
    seeds = {mount.seed.path for mount in _mounts(inputs, "volume") if mount.seed}
    trees = {path: _tree(path, blobs) for path in sorted(shipped | seeds)}
    images = robot_images(inputs, blobs)
    members = {robot for robot in inputs.placed.values() if robot in inputs.snapshot.facts}
    hosts = members | set(images) | set(_witnesses(inputs, members))
    data = {mount: data_set(inputs.instance, mount) for mount in _mounts(inputs, "data")}
    files = RobotFiles(inputs, blobs)
    services: dict[str, list[Service]] = {}
    for name, robot in sorted(inputs.placed.items()):
        services.setdefault(robot, []).append(inputs.experiment.services[name])
    return {
        host: _one(inputs, host, services.get(host, []), images.get(host, []), trees, data, files)
        for host in sorted(hosts)
    }, blobs


def _witnesses(inputs: RenderInputs, members: Collection[str]) -> list[str]:
    """Return robots beyond the members that keep the placement record too.

    When all members are out of reach, they are who knows that services may still run there. Those that keep the one
    that is believed go on doing so; then names decide.
    """
    keepers = {host for host, held in inputs.snapshot.records.items() if inputs.instance in held}
    others = [host for host, facts in inputs.snapshot.facts.items() if host not in members and facts.docker is not None]
    return sorted(others, key=lambda host: (host not in keepers, host))[:_WITNESSES]


def _tree(path: str, blobs: dict[str, bytes]) -> dict[str, str]:
    from srprov.disk import tree_tar

    try:
        blob = tree_tar(path)
    except OSError as error:
        raise UsageError(f"{error.filename or path} cannot be shipped: {error.strerror}", code=Code.NO_FILE) from error
    digest = hashlib.sha256(blob).hexdigest()
    blobs[digest] = blob
    return {"blob": digest, "top": Path(path).name}


def _one(
    inputs: RenderInputs, host: str, services: Sequence[Service], images: Sequence[Mapping[str, Any]],
    trees: Mapping[str, Mapping[str, str]], data: Mapping[Mount, Mapping[str, Any]], files: RobotFiles,
) -> dict[str, Any]:  # fmt: skip
    both = [service.name for service in services if service.network == "both"]
    overlay = _overlay(inputs.overlay, host, both, persist=inputs.experiment.network.persist)
    facts = inputs.snapshot.facts[host]
    used = {mount.source for service in services for mount in service.runtime.mounts if mount.kind == "tree"}
    volumes = {m.source: m.seed for service in services for m in service.runtime.mounts if m.kind == "volume"}
    return {
        "host": host,
        "folder": f"{STATE_ROOT}/{inputs.instance}",
        "robot": _robot(facts),
        "instance": inputs.instance,
        "source": inputs.source,
        "api": facts.docker.api_version if facts.docker else "1.41",
        "overlay": overlay,
        "images": list(images),
        "log_driver": facts.docker.log_driver if facts.docker else "",
        "files": files.of(host, services),
        "trees": [
            {"path": tree_path(inputs.instance, trees[source]), "blob": trees[source]["blob"]}
            for source in sorted(used)
        ],
        "data": used_data(data, services),
        "volumes": [
            _volume(inputs, host, volume_name(inputs.instance, name), seed, trees, _made_for(name, services))
            for name, seed in sorted(volumes.items(), key=lambda one: one[0])
        ],
        "secrets": _secrets(inputs.instance, services),
        "services": [service_context(inputs, service, overlay, trees, data) for service in services],
    }


def _made_for(volume: str, services: Sequence[Service]) -> set[str]:
    """Return the services that may write to a volume; where none may, as to maps from a seed, those that read it."""
    having = [one for one in services if any((m.kind, m.source) == ("volume", volume) for m in one.runtime.mounts)]
    return {one.instance_of or one.name for one in [each for each in having if volume in written(each)] or having}


def _volume(
    inputs: RenderInputs, host: str, name: str, seed: Seed | None, trees: Mapping[str, Mapping[str, str]],
    made_for: set[str],
) -> dict[str, Any]:  # fmt: skip
    owner = inputs.data.owner
    source, label = inputs.data.copies.get((host, name), ("", ""))
    whose = owner.label(host, name) if owner else ""
    volume = {"name": name, "owner": whose, "from": source, "proof": label, "services": sorted(made_for)}
    if source:  # a copy is what it is a copy of
        there = (one for one in inputs.snapshot.observed.get(source, ()) if (one.module, one.name) == ("volume", name))
        state = next((one.state for one in there), {})
        every = sorted(made_for.union(state.get("services", ())))
        return {**volume, "seed": str(state.get("seed", "")), "blob": "", "services": every}
    return {**volume, "blob": trees[seed.path]["blob"] if seed else "", "user": seed.user if seed else ""}


def _robot(facts: HostFacts) -> dict[str, Any]:
    """Return what users' playbooks may decide by: facts that do not change by themselves."""
    lasting = {"arch": facts.arch, "cpus": facts.cpus, "memory": facts.memory_total, "kernel": facts.kernel}
    return {**lasting, "os": facts.os, "tags": list(facts.tags), "devices": list(facts.devices)}


def _secrets(instance: str, services: Sequence[Service]) -> list[dict[str, str]]:
    """Return the secrets of a robot's services: names and places, never values."""
    wanted = {(use.source, use.mode) for service in services for use in service.secrets}
    return [{"path": secret_path(instance, name, mode), "name": name, "mode": mode} for name, mode in sorted(wanted)]


def _overlay(overlay: Overlay, host: str, both: Sequence[str], *, persist: bool) -> dict[str, Any] | None:
    """Return a robot's end of the overlay; `both` are its services that have their address on its bridge."""
    if host not in overlay.vteps:
        return None
    fdb = [[_FLOOD, vtep] for vtep in overlay.flood[host]] + [list(entry) for entry in overlay.fdb[host]]
    tunnel = overlay.tunnel
    return {
        "network": overlay.network,
        "bridge": overlay.bridge,
        "link": overlay.link,
        "subnet": str(overlay.subnet),
        "gateway": str(overlay.gateways[host]),
        "mtu": overlay.mtu,
        "vni": overlay.vni,
        "port": overlay.port,
        "vtep": overlay.gateways[host] if tunnel else overlay.vteps[host],
        "peers": list(overlay.flood[host]),
        "fdb": sorted(fdb),
        "bridge_mac": overlay.bridge_macs[host],
        "addresses": sorted(overlay.addresses[name] for name in both),
        "unit": unit_name(overlay.instance) if persist else "",
        "tunnel": _tunnel(overlay, tunnel, host) if tunnel else None,
    }


def _tunnel(overlay: Overlay, tunnel: Tunnel, host: str) -> dict[str, Any]:
    """Return what encrypts the overlay on one robot."""
    others = sorted(overlay.vteps.keys() - {host})
    return {
        "netns": tunnel.netns,
        "interface": tunnel.interface,
        "address": overlay.gateways[host],
        "port": tunnel.port,
        "mtu": tunnel.mtu,
        "peers": [[other, tunnel.endpoints[other], overlay.gateways[other]] for other in others],
        "to": sorted(overlay.gateways[other] for other in others),
        "others": others,
    }


def _mounts(inputs: RenderInputs, kind: str) -> list[Mount]:
    return [m for service in inputs.experiment.services.values() for m in service.runtime.mounts if m.kind == kind]
