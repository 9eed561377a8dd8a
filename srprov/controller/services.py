"""One service as the playbooks see it: a container's parameters as JSON values. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import msgspec

from srprov.controller.render_inputs import RenderInputs
from srprov.controller.robot_images import image_of
from srprov.definitions.containermodel import Mount, Runtime
from srprov.definitions.model import Experiment, Service
from srprov.definitions.trialsmodel import folder_of
from srprov.modules.container_names import container_name
from srprov.modules.differences import ELSEWHERE
from srprov.modules.module import OWN_HOSTS, STATE_ROOT
from srprov.modules.network import network_hash
from srprov.modules.secret import secret_path
from srprov.modules.volume import volume_name
from srprov.network.discovery import FOLDER, Discovery, discovery_of
from srprov.network.layout import ON_OVERLAY
from srprov.resource import resource_id
from srprov.wire import DATA_STORE


def service_context(
    inputs: RenderInputs,
    service: Service,
    overlay: Mapping[str, Any] | None,
    trees: Mapping[str, Mapping[str, str]],
    data: Mapping[Mount, Mapping[str, Any]],
) -> dict[str, Any]:
    """Return a service as the playbooks see it.

    Args:
        inputs: What contexts are made of.
        service: The service.
        overlay: The robot's end of the overlay, if it has one.
        trees: Path -> blob and top name of each shipped folder.
        data: Mount -> path and sha256 of each data set.
    """
    image = image_of(inputs, service)
    mounts = [_mount(inputs.instance, mount, trees, data) for mount in service.runtime.mounts]
    needs: list[Any] = [f"image:{image}"]
    found = discovery_of(inputs.experiment, inputs.overlay, service)
    for kind, path, target in _own_files(inputs.instance, service, found):
        mounts.append({"Type": "bind", "Source": path, "Target": target, "ReadOnly": True})
        needs.append(f"{kind}:{path}")
    needs += _network_needs(service, overlay)
    needs += [f"tree:{tree_path(inputs.instance, trees[m.source])}" for m in service.runtime.mounts if m.kind == "tree"]
    needs += [f"data:{data[m]['path']}" for m in service.runtime.mounts if m.kind == "data"]
    needs += [f"volume:{volume_name(inputs.instance, m.source)}" for m in service.runtime.mounts if m.kind == "volume"]
    needs += [_dependency(inputs, other, condition) for other, condition in sorted(service.depends_on.items())]
    return {
        "name": service.name,
        "container": container_name(inputs.instance, service.name),
        "image": image,
        # Docker refuses a hostname beside the host's network
        "hostname": "" if with_robots_network(service) else service.runtime.hostname or service.name,
        "job": service.runtime.job,
        "run": _run(service.runtime, found.environment),
        "made_with": dict(found.made_with),
        "taken": _taken(inputs.experiment, service),
        "mounts": [*mounts, *_result_volumes(inputs.experiment, service, mounts)],
        "network": _network(inputs, service, overlay),
        "needs": needs,
    }


def _taken(experiment: Experiment, service: Service) -> list[str]:
    """Return the variables that a service has of the controller's environment, and whether it has files from elsewhere.

    What is outside for no service, such as the EDF itself, whose name then has a blank, is outside for all.
    """
    names = {service.name, service.instance_of}
    outside = any(name in names or " " in name for name, *_ in (*experiment.outside, *experiment.remote))
    variables = {variable for name, variable in experiment.environment if name in names}
    return sorted({*variables, *([ELSEWHERE] if outside else [])})


def _own_files(instance: str, service: Service, found: Discovery) -> Iterator[tuple[str, str, str]]:
    """Yield what srprov itself mounts: kind and path on the robot, and path in the container."""
    for use in service.secrets:
        yield "secret", secret_path(instance, use.source, use.mode), use.target
    if service.network != "none" or service.runtime.extra_hosts:
        yield "file", hosts_path(instance, service), "/etc/hosts"
    for name in found.files:
        yield "file", discovery_path(instance, service, name), f"{FOLDER}/{name}"


def _network_needs(service: Service, overlay: Mapping[str, Any] | None) -> list[str]:
    """Return what of the overlay a service needs; one of `both` has no end at Docker's network."""
    if overlay is None or service.network not in ON_OVERLAY:
        return []
    network = [f"network:{overlay['network']}"] if service.network == "overlay" else []
    return [*network, f"vxlan:{overlay['link']}"]


def _result_volumes(
    experiment: Experiment, service: Service, mounts: Sequence[Mapping[str, Any]]
) -> list[Mapping[str, Any]]:
    """Return a volume for each folder of a service's results that no mount of its has.

    They have no name: the engine removes them with their container, whoever removes that.
    """
    targets = [str(mount["Target"]).rstrip("/") for mount in mounts]
    made: list[Mapping[str, Any]] = []
    wanted = experiment.trials.results if experiment.trials else {}
    for result in wanted.get(service.instance_of or service.name, ()):
        folder = folder_of(result.path)
        if not any(folder == target or folder.startswith(f"{target}/") for target in targets):
            targets.append(folder)
            made.append({"Type": "volume", "Target": folder})
    return made


def hosts_path(instance: str, service: Service) -> str:
    """Return where the hosts file of a service lies on its robot: one for all, unless it has names of its own.

    Those with the robot's network share another one.
    """
    shared = OWN_HOSTS if with_robots_network(service) else ""
    return f"{STATE_ROOT}/{instance}/hosts" + (f"-{service.name}" if service.runtime.extra_hosts else shared)


def with_robots_network(service: Service) -> bool:
    """Return whether a service's container is in the robot's own network, and has the robot's names there."""
    return service.network in ("host", "both")


def discovery_path(instance: str, service: Service, name: str) -> str:
    """Return where a file of `network.discovery` lies on its robot: one for all, unless it has a service's address."""
    stem, dot, kind = name.partition(".")
    return f"{STATE_ROOT}/{instance}/{stem}{f'-{service.name}' if service.network == 'both' else ''}{dot}{kind}"


def tree_path(instance: str, tree: Mapping[str, str]) -> str:
    """Return where a shipped folder lies on the robot."""
    return f"{STATE_ROOT}/{instance}/trees/{tree['blob'][:24]}"


def _dependency(inputs: RenderInputs, other: str, condition: str) -> dict[str, str]:
    name = container_name(inputs.instance, other)
    return {"id": resource_id(inputs.placed[other], "container", name), "condition": condition}


def _network(inputs: RenderInputs, service: Service, overlay: Mapping[str, Any] | None) -> dict[str, str]:
    if service.network == "both" and overlay:
        return {"mode": "both", "ip": str(inputs.overlay.addresses[service.name])}
    if service.network != "overlay" or not overlay:
        return {"mode": service.network}
    return {
        "mode": "overlay",
        "name": overlay["network"],
        "ip": str(inputs.overlay.addresses[service.name]),
        "mac": inputs.overlay.macs[service.name],
        "hash": network_hash(overlay),
    }


def _run(runtime: Runtime, more: Mapping[str, str]) -> dict[str, Any]:
    """Return the run-time fields as JSON values; mounts are given apart, in the engine's form.

    `more` are variables that srprov adds.
    """
    plain = {
        name: getattr(runtime, name)
        for name in runtime.__struct_fields__
        if name not in ("mounts", "healthcheck", "environment", "sysctls", "labels", "logging")
    }
    check, log = runtime.healthcheck, runtime.logging
    return {
        **plain,
        "environment": {**more, **runtime.environment},
        "sysctls": dict(runtime.sysctls),
        "labels": dict(runtime.labels),
        "logging": {"driver": log.driver, "options": dict(log.options)} if log else None,
        "healthcheck": msgspec.structs.asdict(check) if check else None,
    }


def _mount(
    instance: str, mount: Mount, trees: Mapping[str, Mapping[str, str]], data: Mapping[Mount, Mapping[str, Any]]
) -> dict[str, Any]:
    if mount.kind == "tmpfs":
        return {"Type": "tmpfs", "Target": mount.target, **({"Options": mount.options} if mount.options else {})}
    if mount.kind == "volume":
        source: dict[str, Any] = {"Type": "volume", "Source": volume_name(instance, mount.source)}
    elif mount.kind == "tree":
        tree = trees[mount.source]
        source = {"Type": "bind", "Source": f"{tree_path(instance, tree)}/{tree['top']}"}
    elif mount.kind == "data":
        source = {"Type": "bind", "Source": f"{DATA_STORE}/{data[mount]['sha256']}/data"}
    else:
        make = {"BindOptions": {"CreateMountpoint": True}} if mount.create_host_path else {}
        source = {"Type": "bind", "Source": mount.source, **make}
    # shipped files are the experiment's own text: a container that wrote to them would make two robots differ
    return {**source, "Target": mount.target, "ReadOnly": mount.read_only or mount.kind == "tree"}
