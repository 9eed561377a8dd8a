"""What a container is, in one form: of a service as srprov has it, and of one as `docker compose config` prints it.

Both go through different code: the one through definitions alone, the other through an export and the real Compose.
Files that are shipped are compared by what they hold.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from srprov.definitions.model import Service

_LONG = {"started": "service_started", "healthy": "service_healthy", "completed": "service_completed_successfully"}
_UNITS = {"h": 3600.0, "m": 60.0, "s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
SAME = (
    *("command", "entrypoint", "working_dir", "user", "stop_signal", "cap_add", "cap_drop", "privileged", "group_add"),
    *("security_opt", "device_cgroup_rules", "tty", "stdin_open", "init", "read_only", "oom_score_adj", "cpuset"),
    *("pids_limit", "ipc", "pid", "runtime", "restart", "pull_policy", "tmpfs", "labels", "sysctls"),
)


def content(path: str) -> str:
    """Return a hash of a file, or of all that a folder holds."""
    root = Path(path)
    found = [root] if root.is_file() else sorted(one for one in root.rglob("*") if one.is_file())
    digest = hashlib.sha256()
    for one in found:
        digest.update(f"{one.relative_to(root)}\0".encode() + one.read_bytes())
    return digest.hexdigest()[:12]


def of_service(service: Service, more: Mapping[str, str] | None = None) -> dict[str, Any]:
    """Return a service as it is wanted; `more` are variables that discovery adds."""
    run = service.runtime
    check, log = run.healthcheck, run.logging
    shared = service.network in ("host", "both")
    found: dict[str, Any] = {
        **{name: getattr(run, name) for name in SAME if name != "tmpfs"},
        "tmpfs": {one.target: one.options for one in run.mounts if one.kind == "tmpfs"},
        "network_mode": {"host": "host", "both": "host", "none": "none"}.get(service.network, ""),
        "hostname": "" if shared else run.hostname or service.name,
        "stop_grace_s": run.stop_grace_s,
        "healthcheck": (check.test, check.interval_s, check.timeout_s, check.retries, check.start_period_s)
        if check and check.test != ("NONE",) else "off" if check else None,
        "devices": set(run.devices),
        "ports": set(run.ports),
        "expose": set(run.expose),
        "ulimits": {name: (soft, hard) for name, soft, hard in run.ulimits},
        "logging": (log.driver, dict(log.options)) if log else None,
        "memory": (run.mem_limit, run.mem_reservation, run.shm_size),
        "cpus": run.cpus,
        "gpus": run.gpus,
        "environment": {**(more or {}), **run.environment},
        "extra_hosts": set(run.extra_hosts),
        "depends_on": {other: _LONG[how] for other, how in service.depends_on.items()},
        "secrets": {use.target: (use.source, use.mode) for use in service.secrets},
        "profiles": set(service.profiles),
        "volumes": {one.target: _mount_of(one) for one in run.mounts if one.kind != "tmpfs"},
    }  # fmt: skip
    sysctls = found["sysctls"]
    found["sysctls"] = {name: value for name, value in sysctls.items() if not (shared and name.startswith("net."))}
    return _with_plain(found)


def _mount_of(one: Any) -> tuple[str, str, bool]:
    if one.kind == "volume":
        return ("folder", content(one.seed.path), one.read_only) if one.seed else ("volume", one.source, one.read_only)
    if one.kind == "bind":
        return ("bind", f"{one.source} {one.create_host_path}", one.read_only)
    return ("folder", content(one.source), True)


def of_compose(one: Mapping[str, Any], folder: str) -> dict[str, Any]:
    """Return a service of `config --format json`; paths below `folder` are the export's own."""
    check, deploy = one.get("healthcheck"), one.get("deploy", {})
    log, devices = one.get("logging"), deploy.get("resources", {}).get("reservations", {}).get("devices", [])
    found: dict[str, Any] = {
        **{name: one.get(name) for name in SAME},
        "restart": one.get("restart") or "no",
        "pull_policy": one.get("pull_policy") or "missing",
        "tmpfs": dict(tuple(each.partition(":")[::2]) for each in one.get("tmpfs") or ()),
        "network_mode": one.get("network_mode"),
        "hostname": one.get("hostname"),
        "stop_grace_s": seconds(one.get("stop_grace_period", "10s")),
        "healthcheck": _check(check) if check else None,
        "devices": {(each["source"], each["target"], each["permissions"]) for each in one.get("devices") or ()},
        "ports": {
            (each.get("host_ip", ""), int(each["published"]), each["target"], each["protocol"])
            for each in one.get("ports") or ()
        },
        "expose": {(int(port), kind or "tcp") for port, _, kind in (e.partition("/") for e in one.get("expose") or ())},
        "ulimits": {
            name: (each.get("soft", 0), each.get("hard", 0)) if isinstance(each, dict) else (each, each)
            for name, each in (one.get("ulimits") or {}).items()
        },
        "logging": (log.get("driver", ""), log.get("options", {})) if log else None,
        "memory": tuple(int(one.get(key) or 0) for key in ("mem_limit", "mem_reservation", "shm_size")),
        "cpus": float(one.get("cpus") or 0),
        "gpus": {-1: "all", "-1": "all", "all": "all"}.get(devices[0]["count"], str(devices[0]["count"]))
        if devices
        else "",
        "environment": one.get("environment"),
        "extra_hosts": {tuple(each.split("=", 1)) for each in one.get("extra_hosts") or ()},
        "depends_on": {other: how["condition"] for other, how in (one.get("depends_on") or {}).items()},
        "secrets": {each["target"]: (each["source"], each["mode"]) for each in one.get("secrets") or ()},
        "profiles": set(one.get("profiles") or ()),
        "volumes": {each["target"]: _mount(each, folder) for each in one.get("volumes") or ()},
    }
    assert one.get("memswap_limit") == one.get("mem_limit")
    return _with_plain(found)


def _check(check: Mapping[str, Any]) -> object:
    if check.get("disable"):
        return "off"
    times = [seconds(check[key]) for key in ("interval", "timeout")]
    return (tuple(check["test"]), *times, check["retries"], seconds(check["start_period"]))


def _mount(one: Mapping[str, Any], folder: str) -> tuple[str, str, bool]:
    source, read_only = one["source"], bool(one.get("read_only"))
    if one["type"] == "volume":
        return ("volume", source, read_only)
    if source.startswith(f"{folder}/"):
        return ("folder", content(source), read_only)
    return ("bind", f"{source} {bool(one['bind'].get('create_host_path'))}", read_only)


def seconds(text: str) -> float:
    """Read a duration as Go prints it."""
    total, rest = 0.0, text
    while rest:
        digits = len(rest) - len(rest.lstrip("0123456789."))
        after = rest[digits:]
        unit = after[: len(after) - len(after.lstrip("hmsunµ"))] if after else "s"
        unit = next(name for name in ("ms", "us", "µs", "ns", "h", "m", "s") if unit.startswith(name))
        total += float(rest[:digits]) * _UNITS[unit]
        rest = after[len(unit) :]
    return total


def _with_plain(found: Mapping[str, Any]) -> dict[str, Any]:
    # an empty command takes the image's away, and no init process is not the engine's default
    kept = {name: _plain(found[name]) if found[name] else found[name] for name in ("command", "entrypoint", "init")}
    kept |= {name: tuple(kept[name]) for name in ("command", "entrypoint") if kept[name] is not None}
    return {name: kept[name] if name in kept else _plain(value) for name, value in found.items()}


def _plain(value: Any) -> Any:
    """Return a value in which nothing, zero and what is not said are one."""
    if isinstance(value, Mapping):
        value = dict(value)
    if isinstance(value, tuple | list):
        value = tuple(value)
    if isinstance(value, float):
        value = round(value, 6)
    return value or None
