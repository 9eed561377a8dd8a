"""What a container is made with, field by field in the words of an EDF: of one that is wanted, or that is there.

Both are in the engine's form, so one table reads both. What an engine fills in, or the image brings along, is no
difference where nothing was said of it. Pure.

Source: Docker Engine API 1.41, "Inspect a container", "Inspect an image".
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from msgspec.structs import replace

from srprov.modules.container_body import PART_DIGITS, differing_parts, engine_body, parts_of
from srprov.modules.container_params import ContainerParams
from srprov.modules.differences import bounded, compared, untold
from srprov.resource import Difference, State
from srprov.untrusted import integer, is_of_one, mapping, mappings, string, string_map, strings
from srprov.wire import Reply

Parts = dict[str, dict[str, str]]
"""Part, as `parts_of` names it -> field -> value as text; fields without a value are left out or empty."""

_OURS = ("srprov.", "com.docker.compose.")
_SECOND_NS = 1_000_000_000
_FROM_IMAGE = ("command", "environment", "healthcheck", "labels")
"""Parts that an image brings along."""
_ALSO_FROM_IMAGE = ("user", "working_dir", "stop_signal", "expose")
_FILLED_IN = {"shm_size": ("64m",), "ipc": ("private", "shareable"), "runtime": ("runc",), "logging": ("json-file",),
              "restart": ("no",), "security_opt": ("label=disable",)}  # fmt: skip
"""Field -> what an engine puts there when nothing was said."""


def wanted_values(want: ContainerParams, *, made: bool = False) -> Parts:
    """Return the values of a wanted container; with `made`, also of the variables that it gets only when it is made."""
    body = engine_body(replace(want, api="1.41", made_with=want.made_with if made else {}))
    network = want.network
    at = {"network": _mode(network.mode), "network.ip": (network.name and network.ip) or "", "network.mac": ""}
    at["network.mac"] = (network.name and network.mac) or ""
    return {**_parts(body, mapping(body["HostConfig"])), "labels": _labels(want.run.labels), "network": at}


def differing_values(want: ContainerParams, found: State, replies: Sequence[Reply]) -> tuple[Difference, ...]:
    """Return which values differ from those of a container that is there; `replies` inspect it and its image."""
    readable = replies and replies[0].ok and all(is_of_one(one.out) for one in replies)
    about = mapping(replies[0].json()) if readable else {}
    if not about:
        return (Difference(field="container", note="its old values were not read"),)
    wanted, there = wanted_values(want, made=True), _found(about, want)
    brought = _brought(replies[1])
    differing: list[Difference] = []
    for part in _differing_parts(want, found):
        new = wanted.get(part, {})
        base = None if brought is None else brought.get(part, {})
        kept = {key: value for key, value in there.get(part, {}).items() if _counts(part, key, value, new, base)}
        differing += compared(kept, new)
    return untold(bounded(differing), found.get("taken", ()), want.taken)


def between(old: ContainerParams, new: ContainerParams) -> tuple[Difference, ...]:
    """Return which values of two wanted containers differ."""
    before, after = wanted_values(old), wanted_values(new)
    parts = sorted({*before, *after})
    return tuple(one for part in parts for one in compared(before.get(part, {}), after.get(part, {})))


def _brought(reply: Reply) -> Parts | None:
    """Return what an image gives its containers; None where the engine does not say."""
    config = mapping(reply.json()).get("Config") if reply.ok else None
    if not isinstance(config, Mapping):
        return None
    return {**_parts(config, {}), "labels": _labels(string_map(config.get("Labels")))}


def _differing_parts(want: ContainerParams, found: State) -> list[str]:
    """Return the parts whose hash is another one; all, of a container that has none, or the short ones of before."""
    there = mapping(found["parts"])
    if not there or any(len(string(one)) < PART_DIGITS for one in there.values()):
        return sorted({*parts_of(want), *there})
    return differing_parts(there, want)


def _counts(part: str, field: str, value: str, new: Mapping[str, str], base: Mapping[str, str] | None) -> bool:
    """Return whether what was found in a field is something that somebody said."""
    if new.get(field) or not value:
        return True
    if value in _FILLED_IN.get(field, ()):
        return False
    if part in _FROM_IMAGE or field.partition(".")[0] in _ALSO_FROM_IMAGE:
        return base is not None and base.get(field) != value
    return True


def _found(about: Mapping[str, Any], want: ContainerParams) -> Parts:
    """Return the values of a container as the engine tells them."""
    config, host = mapping(about.get("Config")), mapping(about.get("HostConfig"))
    parts = _parts(config, host)
    hostname = parts["options"].get("hostname", "")
    # the engine's own choice: the beginning of the id, or with the robot's network the robot's name
    if hostname == string(about.get("Id"))[:12] or not want.hostname:
        parts["options"].pop("hostname", None)
    mode = string(host.get("NetworkMode"))
    overlay = mode not in ("host", "none", "default", "bridge")
    end = mapping(mapping(mapping(about.get("NetworkSettings")).get("Networks")).get(mode)) if overlay else {}
    ip, mac = string(mapping(end.get("IPAMConfig")).get("IPv4Address")), string(end.get("MacAddress"))
    at = {"network": "overlay" if overlay else mode, "network.ip": ip, "network.mac": mac}
    if overlay and not mac:  # one that does not run has no end with one
        at["network.mac"] = string(config.get("MacAddress")) or (want.network.mac or "")
    return {**parts, "labels": _labels(string_map(config.get("Labels"))), "network": at}


def _parts(config: Mapping[str, Any], host: Mapping[str, Any]) -> Parts:
    variables = (text.partition("=") for text in strings(config.get("Env")))
    log = mapping(host.get("LogConfig"))
    return {
        "image": {"image": string(config.get("Image"))},
        "command": {"command": _words(config.get("Cmd")), "entrypoint": _words(config.get("Entrypoint"))},
        "environment": {f"environment.{name}": value or '""' for name, _, value in variables},
        "volumes": {f"volumes.{string(one.get('Target'))}": _mount(one) for one in mappings(host.get("Mounts"))},
        "ports": {"ports": _ports(host.get("PortBindings")), **_exposed(config, host)},
        "healthcheck": _healthcheck(mapping(config.get("Healthcheck"))),
        "devices": _devices(host),
        "privileges": _privileges(host),
        "logging": {"logging": " ".join([string(log.get("Type")), *_pairs(log.get("Config"))])},
        "options": _options(config, host),
        "init": {"init": _flag(host.get("Init"))},
    }


def _privileges(host: Mapping[str, Any]) -> dict[str, str]:
    named = {"CapAdd": "cap_add", "CapDrop": "cap_drop", "SecurityOpt": "security_opt", "GroupAdd": "group_add"}
    return {
        "privileged": _flag(host.get("Privileged") or None),
        **{name: ", ".join(strings(host.get(key))) for key, name in named.items()},
        **{f"sysctls.{key}": value for key, value in string_map(host.get("Sysctls")).items()},
        "pid": string(host.get("PidMode")),
        "read_only": _flag(host.get("ReadonlyRootfs") or None),
        "runtime": string(host.get("Runtime")),
    }


def _options(config: Mapping[str, Any], host: Mapping[str, Any]) -> dict[str, str]:
    policy = mapping(host.get("RestartPolicy"))
    count = integer(policy.get("MaximumRetryCount"))
    quota = integer(host.get("CpuQuota")) / 100_000
    limits = [
        f"{string(one.get('Name'))} {integer(one.get('Soft'), low=-1)}:{integer(one.get('Hard'), low=-1)}"
        for one in mappings(host.get("Ulimits"))
    ]
    texts = {"Hostname": "hostname", "WorkingDir": "working_dir", "User": "user", "StopSignal": "stop_signal"}
    sizes = {"ShmSize": "shm_size", "Memory": "mem_limit", "MemoryReservation": "mem_reservation"}
    return {
        **{name: string(config.get(key)) for key, name in texts.items()},
        "stop_grace_period": _number(config.get("StopTimeout"), "s"),
        "tty": _flag(config.get("Tty") or None),
        "stdin_open": _flag(config.get("OpenStdin") or None),
        "restart": string(policy.get("Name")) + (f":{count}" if count else ""),
        "ulimits": ", ".join(limits),
        "ipc": string(host.get("IpcMode")),
        **{f"tmpfs.{path}": value or "no options" for path, value in string_map(host.get("Tmpfs")).items()},
        **{name: _size(host.get(key)) for key, name in sizes.items()},
        "pids_limit": _number(host.get("PidsLimit")),
        "cpus": f"{quota:g}" if quota else "",
        "cpuset": string(host.get("CpusetCpus")),
        "oom_score_adj": _number(host.get("OomScoreAdj")),
    }


def _devices(host: Mapping[str, Any]) -> dict[str, str]:
    keys = ("PathOnHost", "PathInContainer", "CgroupPermissions")
    listed = [":".join(string(one.get(key)) for key in keys) for one in mappings(host.get("Devices"))]
    gpus = [integer(one.get("Count"), low=-1) for one in mappings(host.get("DeviceRequests"))]
    return {
        "devices": ", ".join(listed),
        "gpus": ", ".join("all" if count < 0 else str(count) for count in gpus),
        "device_cgroup_rules": ", ".join(strings(host.get("DeviceCgroupRules"))),
    }


def _healthcheck(check: Mapping[str, Any]) -> dict[str, str]:
    times = {"Interval": "interval", "Timeout": "timeout", "StartPeriod": "start_period"}
    return {
        "healthcheck.test": _words(check.get("Test")),
        **{f"healthcheck.{name}": _seconds(check.get(key)) for key, name in times.items()},
        "healthcheck.retries": _number(check.get("Retries")),
    }


def _mount(one: Mapping[str, Any]) -> str:
    return f"{string(one.get('Type'))} {string(one.get('Source'))}{' (read-only)' if one.get('ReadOnly') else ''}"


def _ports(bindings: object) -> str:
    shown = []
    for inside, ends in mapping(bindings).items():
        for end in mappings(ends):
            address = string(end.get("HostIp"))
            shown.append(f"{address + ':' if address else ''}{string(end.get('HostPort'))}:{inside}")
    return ", ".join(sorted(shown))


def _exposed(config: Mapping[str, Any], host: Mapping[str, Any]) -> dict[str, str]:
    """Return the ports that are exposed and not published, each a field: an image's are among a container's."""
    ports = set(mapping(config.get("ExposedPorts"))) - set(mapping(host.get("PortBindings")))
    return {f"expose.{string(port)}": "exposed" for port in ports}


def _labels(labels: Mapping[str, str]) -> dict[str, str]:
    return {f"labels.{key}": value or '""' for key, value in labels.items() if not key.startswith(_OURS)}


def _words(value: object) -> str:
    """Return a command as words of a shell."""
    from srprov.wire import sh

    words = strings(value)
    return sh(*(word.replace("\0", "") for word in words)) if words else ""


def _pairs(value: object) -> Iterable[str]:
    return (f"{key}={one}" for key, one in sorted(string_map(value).items()))


def _seconds(value: object) -> str:
    nanoseconds = integer(value)
    return f"{nanoseconds / _SECOND_NS:g}s" if nanoseconds else ""


def _number(value: object, unit: str = "") -> str:
    number = integer(value, low=-(10**18))
    return f"{number}{unit}" if number > 0 or (number < 0 and not unit) else ""


def _size(value: object) -> str:
    """Return bytes as an EDF has them: `64m`."""
    size = integer(value)
    for unit, factor in (("g", 1 << 30), ("m", 1 << 20), ("k", 1 << 10)):
        if size and size % factor == 0:
            return f"{size // factor}{unit}"
    return str(size) if size else ""


def _flag(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else ""


def _mode(mode: str) -> str:
    return "host" if mode == "both" else mode
