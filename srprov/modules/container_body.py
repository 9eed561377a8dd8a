"""A container's wanted parameters as the Docker Engine's JSON, and as the named parts that its hash is made of.

Pure translation: Compose's words on one side, the Engine API's on the other. The body holds no label and no name.

Source: Docker Engine API 1.41, "Create a container"; from 1.44 the MAC address moved into the endpoint.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

_SECOND_NS = 1_000_000_000


def engine_body(params: Mapping[str, Any]) -> dict[str, Any]:
    """Return the create request's JSON. `params` as the module's docstring lists them."""
    run = params["run"]
    body: dict[str, Any] = {
        "Image": params["image"],
        "Env": [f"{key}={value}" for key, value in sorted(run["environment"].items())],
        "Tty": run["tty"],
        "StopTimeout": round(run["stop_grace_s"]),
        "HostConfig": _host_config(params),
    }
    if params["hostname"]:
        body["Hostname"] = params["hostname"]
    for key, name in (("command", "Cmd"), ("entrypoint", "Entrypoint")):
        if run[key] is not None:
            body[name] = list(run[key])
    for key, name in (("working_dir", "WorkingDir"), ("user", "User"), ("stop_signal", "StopSignal")):
        if run[key]:
            body[name] = run[key]
    if run["healthcheck"]:
        body["Healthcheck"] = _healthcheck(run["healthcheck"])
    if run["ports"]:
        body["ExposedPorts"] = {f"{inside}/{protocol}": {} for _, _, inside, protocol in run["ports"]}
    _add_network(body, params)
    return body


def parts_of(params: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parts that decide whether a running container is still the wanted one, by the name that a cause shows.

    The MAC's place in the body depends on the engine's version, so the network part is the wish, not the body: an
    engine's upgrade restarts nothing.
    """
    body = engine_body({**params, "api": "1.41"})
    host = body["HostConfig"]
    network = params["network"]
    return {
        "image": body["Image"],
        "command": [body.get("Cmd"), body.get("Entrypoint")],
        "environment": body["Env"],
        "volumes": host.get("Mounts", []),
        "network": [network.get(key) for key in ("mode", "name", "ip", "mac", "hash")],
        "ports": [body.get("ExposedPorts"), host.get("PortBindings")],
        "healthcheck": body.get("Healthcheck"),
        "devices": [host.get(key) for key in ("Devices", "DeviceRequests", "DeviceCgroupRules")],
        "privileges": [host.get(k) for k in ("Privileged", "CapAdd", "SecurityOpt", "GroupAdd", "Sysctls", "PidMode")],
        "options": [
            [body.get(k) for k in ("Hostname", "WorkingDir", "User", "StopSignal", "StopTimeout", "Tty")],
            [host.get(k) for k in ("RestartPolicy", "Ulimits", "ShmSize", "IpcMode", "Tmpfs")],
        ],
    }


def _host_config(params: Mapping[str, Any]) -> dict[str, Any]:
    run = params["run"]
    host: dict[str, Any] = {"RestartPolicy": _restart(run["restart"]), "Privileged": run["privileged"]}
    mounts = [mount for mount in params["mounts"] if mount["Type"] != "tmpfs"]
    optional = {
        "Mounts": mounts,
        "Tmpfs": {mount["Target"]: "" for mount in params["mounts"] if mount["Type"] == "tmpfs"},
        "Devices": [
            {"PathOnHost": path, "PathInContainer": inside, "CgroupPermissions": rights}
            for path, inside, rights in run["devices"]
        ],
        "DeviceCgroupRules": list(run["device_cgroup_rules"]),
        "DeviceRequests": _gpus(run["gpus"]),
        "PortBindings": _port_bindings(run["ports"]),
        "Ulimits": [{"Name": name, "Soft": soft, "Hard": hard} for name, soft, hard in run["ulimits"]],
        "CapAdd": list(run["cap_add"]),
        "Sysctls": dict(sorted(run["sysctls"].items())),
        "GroupAdd": list(run["group_add"]),
        "SecurityOpt": list(run["security_opt"]),
        "ShmSize": run["shm_size"],
        "IpcMode": run["ipc"],
        "PidMode": run["pid"],
    }
    host.update({key: value for key, value in optional.items() if value})
    return host


def _add_network(body: dict[str, Any], params: Mapping[str, Any]) -> None:
    network = params["network"]
    host = body["HostConfig"]
    if network["mode"] != "overlay":
        host["NetworkMode"] = network["mode"]
        return
    host["NetworkMode"] = network["name"]
    endpoint: dict[str, Any] = {"IPAMConfig": {"IPv4Address": network["ip"]}}
    if _version(params["api"]) >= (1, 44):
        endpoint["MacAddress"] = network["mac"]
    else:
        body["MacAddress"] = network["mac"]
    body["NetworkingConfig"] = {"EndpointsConfig": {network["name"]: endpoint}}


def _healthcheck(check: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "Test": list(check["test"]),
        "Interval": round(check["interval_s"] * _SECOND_NS),
        "Timeout": round(check["timeout_s"] * _SECOND_NS),
        "StartPeriod": round(check["start_period_s"] * _SECOND_NS),
        "Retries": check["retries"],
    }


def _restart(policy: str) -> dict[str, Any]:
    name, _, count = policy.partition(":")
    return {"Name": name, "MaximumRetryCount": int(count) if count else 0}


def _gpus(wish: str) -> list[dict[str, Any]]:
    if not wish:
        return []
    return [{"Driver": "", "Count": -1 if wish == "all" else int(wish), "Capabilities": [["gpu"]]}]


def _port_bindings(ports: object) -> dict[str, list[dict[str, str]]]:
    bindings: dict[str, list[dict[str, str]]] = {}
    for address, published, inside, protocol in ports if isinstance(ports, (list, tuple)) else ():
        bindings.setdefault(f"{inside}/{protocol}", []).append({"HostIp": address, "HostPort": str(published)})
    return bindings


def _version(text: str) -> tuple[int, ...]:
    return tuple(int(part) if part.isdigit() else 0 for part in text.split("."))
