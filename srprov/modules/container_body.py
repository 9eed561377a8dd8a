"""A container's wanted parameters as the Docker Engine's JSON, and as the named parts that its hash is made of.

Pure translation: Compose's words on one side, the Engine API's on the other. The body holds no label and no name.

Source: Docker Engine API 1.41, "Create a container"; from 1.44 the MAC address moved into the endpoint.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from msgspec.structs import replace

from srprov.definitions.containermodel import HealthCheck
from srprov.modules.container_params import ContainerParams, NetworkPlace
from srprov.modules.module import OWN_HOSTS, digest

_SECOND_NS = 1_000_000_000
_PERIOD_US = 100_000
LOGS_BY_DEFAULT = "default"
"""Of a container of which nothing is said: the part of its hash about logs."""
PART_DIGITS = 32
"""Of the hash of a part. Two values with 8 equal digits are found within a second, and a plan would show neither."""
_OLD_DIGITS = 8
"""That containers of older versions have."""
_NEW_DEFAULTS = {"logging": "logs rotate", "init": "an init process runs first"}
"""Part of the configuration that containers of older versions do not have -> what is new."""
_ROTATION = {"max-file": "3", "max-size": "10m"}
"""Of the engine's own `json-file`, which keeps everything for ever."""
_ROTATED = "json-file"
_LIMITS = ("Memory", "CpuQuota", "PidsLimit")
_MORE_LIMITS = ("MemoryReservation", "CpusetCpus", "OomScoreAdj")
"""These and what else came later are part of the hash only where there is one: containers without any stay the same."""


def engine_body(want: ContainerParams) -> dict[str, Any]:
    """Return the create request's JSON."""
    run = want.run
    body: dict[str, Any] = {
        "Image": want.image,
        "Env": [f"{key}={value}" for key, value in sorted({**want.made_with, **run.environment}.items())],
        "Tty": run.tty,
        **({"OpenStdin": True} if run.stdin_open else {}),
        "StopTimeout": round(run.stop_grace_s),
        "HostConfig": _host_config(want),
    }
    if run.command is not None:
        body["Cmd"] = list(run.command)
    if run.entrypoint is not None:
        body["Entrypoint"] = list(run.entrypoint)
    optional: dict[str, Any] = {
        "Hostname": want.hostname,
        "WorkingDir": run.working_dir,
        "User": run.user,
        "StopSignal": run.stop_signal,
        "Healthcheck": _healthcheck(run.healthcheck) if run.healthcheck else None,
        "ExposedPorts": {
            f"{port}/{protocol}": {} for port, protocol in (*((p[2], p[3]) for p in run.ports), *run.expose)
        },
    }
    body.update({key: value for key, value in optional.items() if value})
    _add_network(body, want)
    return body


def parts_of(want: ContainerParams) -> dict[str, Any]:
    """Return the parts that decide whether a running container is still the wanted one, by the name that a cause shows.

    The MAC's place in the body depends on the engine's version, so the network part is the wish, not the body: an
    engine's upgrade restarts nothing.
    """
    body = engine_body(replace(want, api="1.41", made_with={}))
    host, network = body["HostConfig"], want.network
    log = want.run.logging
    return {
        "image": body["Image"],
        "command": [body.get("Cmd"), body.get("Entrypoint")],
        "environment": body["Env"],
        "volumes": [mount for mount in want.mounts if mount["Type"] != "tmpfs"],
        "network": [_mode(network), network.name, network.ip if network.name else None, network.mac, network.hash],
        "ports": [body.get("ExposedPorts"), host.get("PortBindings")],
        "healthcheck": body.get("Healthcheck"),
        "devices": [host.get(key) for key in ("Devices", "DeviceRequests", "DeviceCgroupRules")],
        "privileges": [
            *(host.get(k) for k in ("Privileged", "CapAdd", "SecurityOpt", "GroupAdd", "Sysctls", "PidMode")),
            *_given(host, ("CapDrop", "ReadonlyRootfs", "Runtime")),
        ],
        # which driver an engine has by default is its own business, and restarts nothing
        "logging": [log.driver, dict(log.options)] if log else LOGS_BY_DEFAULT,
        "options": [
            [body.get(k) for k in ("Hostname", "WorkingDir", "User", "StopSignal", "StopTimeout", "Tty")],
            [host.get(k) for k in ("RestartPolicy", "Ulimits", "ShmSize", "IpcMode", "Tmpfs")],
            *_given(host, _LIMITS),
            *_given(host, _MORE_LIMITS),
            *_given(body, ("OpenStdin",)),
        ],
        **({"init": host["Init"]} if "Init" in host else {}),
        **({"kept variables": sorted(want.made_with)} if want.made_with else {}),
        **({"labels": dict(sorted(want.run.labels.items()))} if want.run.labels else {}),
    }


def differing(found: Mapping[str, str], want: ContainerParams) -> str:
    """Return in words in which parts a container differs from the wanted one; `found` is name -> short hash."""
    names = differing_parts(found, want)
    if names == ["volumes"] and _is_part(found.get("volumes"), _volumes_before(want)):
        return "volumes differs (made by an older srprov; new by default: the robot's own names in /etc/hosts)"
    if not names:
        return "configuration differs"
    cause = f"{', '.join(names)} {'differs' if len(names) == 1 else 'differ'}"
    if not found or "logging" in found or parts_of(want)["logging"] != LOGS_BY_DEFAULT:
        return cause
    new = [words for name, words in _NEW_DEFAULTS.items() if name in names]
    return f"{cause} (made by an older srprov; new by default: {', '.join(new)})"


def differing_parts(found: Mapping[str, object], want: ContainerParams) -> list[str]:
    """Return the names of the parts that differ; `found` is name -> hash, as a container has it."""
    wanted = parts_of(want)
    return sorted(one for one in {*found, *wanted} if not (one in wanted and _is_part(found.get(one), wanted[one])))


def _is_part(told: object, value: object) -> bool:
    """Return whether a hash that a container has of a part is that of a value; it may be of an older version."""
    return isinstance(told, str) and len(told) in (PART_DIGITS, _OLD_DIGITS) and told == digest(value, len(told))


def _volumes_before(want: ContainerParams) -> list[Mapping[str, Any]]:
    """Return the mounts of older versions, in which a hosts file never had the lines of the robot's own."""
    return [
        {**one, "Source": str(one["Source"]).removesuffix(OWN_HOSTS)} if "Source" in one else one
        for one in want.mounts
        if one["Type"] != "tmpfs"
    ]


def _given(body: dict[str, Any], keys: tuple[str, ...]) -> list[list[Any]]:
    """Return the values of some keys as one entry of a list; none where no key has any."""
    found = [body.get(key) for key in keys]
    return [found] if any(one is not None for one in found) else []


def _host_config(want: ContainerParams) -> dict[str, Any]:
    run = want.run
    host: dict[str, Any] = {"RestartPolicy": _restart(run.restart), "Privileged": run.privileged}
    optional = {
        "Mounts": [_as_made(mount) for mount in want.mounts if mount["Type"] != "tmpfs"],
        "Tmpfs": {mount["Target"]: mount.get("Options", "") for mount in want.mounts if mount["Type"] == "tmpfs"},
        "Devices": [
            {"PathOnHost": path, "PathInContainer": inside, "CgroupPermissions": rights}
            for path, inside, rights in run.devices
        ],
        "DeviceCgroupRules": list(run.device_cgroup_rules),
        "DeviceRequests": _gpus(run.gpus),
        "PortBindings": _port_bindings(run.ports),
        "Ulimits": [{"Name": name, "Soft": soft, "Hard": hard} for name, soft, hard in run.ulimits],
        "CapAdd": list(run.cap_add),
        "CapDrop": list(run.cap_drop),
        "ReadonlyRootfs": run.read_only,
        "LogConfig": _log_config(want),
        "Runtime": run.runtime,
        "Sysctls": dict(sorted(run.sysctls.items())),
        "GroupAdd": list(run.group_add),
        "SecurityOpt": list(run.security_opt),
        "ShmSize": run.shm_size,
        "Memory": run.mem_limit,
        "MemorySwap": run.mem_limit,  # of memory and swap together: no swap
        "CpuPeriod": _PERIOD_US if run.cpus else 0,
        "CpuQuota": round(run.cpus * _PERIOD_US),  # NanoCpus would be refused by a robot with fewer
        "CpusetCpus": run.cpuset,
        "MemoryReservation": run.mem_reservation,
        "OomScoreAdj": run.oom_score_adj,
        "PidsLimit": run.pids_limit,
        "IpcMode": run.ipc,
        "PidMode": run.pid,
    }
    host.update({key: value for key, value in optional.items() if value})
    if run.init is not None:
        host["Init"] = run.init
    return host


def _as_made(mount: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a mount as an engine is told it: a volume that is read alone gets no files of the image when it is empty.

    An engine would fill it all the same, and others may run what lies there.
    """
    alone = mount["Type"] == "volume" and mount.get("ReadOnly") is True
    return {**mount, "VolumeOptions": {"NoCopy": True}} if alone else mount


def _log_config(want: ContainerParams) -> dict[str, Any]:
    log = want.run.logging
    if log:
        return {"Type": log.driver, "Config": dict(sorted(log.options.items()))}
    return {"Type": _ROTATED, "Config": _ROTATION} if want.log_driver == _ROTATED else {}


def _add_network(body: dict[str, Any], want: ContainerParams) -> None:
    network = want.network
    host = body["HostConfig"]
    if network.mode != "overlay":
        host["NetworkMode"] = _mode(network)
        return
    host["NetworkMode"] = network.name
    endpoint: dict[str, Any] = {"IPAMConfig": {"IPv4Address": network.ip}}
    if _version(want.api) >= (1, 44):
        endpoint["MacAddress"] = network.mac
    else:
        body["MacAddress"] = network.mac
    body["NetworkingConfig"] = {"EndpointsConfig": {network.name: endpoint}}


def _mode(network: NetworkPlace) -> str:
    """Return the engine's word: it joins the host's network and no other, so `both` is no difference to a container."""
    return "host" if network.mode == "both" else network.mode


def _healthcheck(check: HealthCheck) -> dict[str, Any]:
    return {
        "Test": list(check.test),
        "Interval": round(check.interval_s * _SECOND_NS),
        "Timeout": round(check.timeout_s * _SECOND_NS),
        "StartPeriod": round(check.start_period_s * _SECOND_NS),
        "Retries": check.retries,
    }


def _restart(policy: str) -> dict[str, Any]:
    name, _, count = policy.partition(":")
    return {"Name": name, "MaximumRetryCount": int(count) if count else 0}


def _gpus(wish: str) -> list[dict[str, Any]]:
    if not wish:
        return []
    return [{"Driver": "", "Count": -1 if wish == "all" else int(wish), "Capabilities": [["gpu"]]}]


def _port_bindings(ports: Iterable[tuple[str, int, int, str]]) -> dict[str, list[dict[str, str]]]:
    bindings: dict[str, list[dict[str, str]]] = {}
    for address, published, inside, protocol in ports:
        bindings.setdefault(f"{inside}/{protocol}", []).append({"HostIp": address, "HostPort": str(published)})
    return bindings


def _version(text: str) -> tuple[int, ...]:
    return tuple(int(part) if part.isdecimal() else 0 for part in text.split("."))
