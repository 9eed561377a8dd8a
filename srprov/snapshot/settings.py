"""What a container was told beyond its image and its engine's defaults, but for its mounts: fields of a service.

Takes what an engine says of a container and of its image; gives fields with the EDF's names. Pure. A setting that an
EDF cannot say, or that is not known here, is noted unless it is at its default: nothing goes without a word.

Source: Docker Engine API 1.41, "Inspect a container", and the defaults of moby's `runconfig` and `daemon`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, TypeVar

from srprov.published import ALIKE, may_be_published_at
from srprov.snapshot.notes import Notes
from srprov.untrusted import integer, mapping, mappings, string, string_map, strings, text

_T = TypeVar("_T")
MOST_ENTRIES = 500
_SHM = 64 << 20
_NS = 1_000_000_000
_BOTH = frozenset({"", "default", "private"})
_KNOWN = frozenset((
    "Binds", "ContainerIDFile", "LogConfig", "NetworkMode", "PortBindings", "RestartPolicy", "CapAdd", "CapDrop",
    "ExtraHosts", "GroupAdd", "IpcMode", "OomScoreAdj", "PidMode", "Privileged", "ReadonlyRootfs", "SecurityOpt",
    "Tmpfs", "ShmSize", "Sysctls", "Runtime", "Memory", "MemoryReservation", "MemorySwap", "NanoCpus", "CpuQuota",
    "CpuPeriod", "CpusetCpus", "Devices", "DeviceCgroupRules", "DeviceRequests", "PidsLimit", "Ulimits", "Init",
    "Mounts", "VolumeDriver", "MaskedPaths", "ReadonlyPaths", "ConsoleSize", "Isolation",
))  # fmt: skip
"""Of HostConfig: what is taken over here or in `mounts`, and what follows from other settings."""
_DEFAULTS: Mapping[str, tuple[object, ...]] = {
    "CgroupnsMode": ("", "private", "host"),
    "MemorySwappiness": (-1,),
    "Cgroup": ("", "default"),
    "UTSMode": ("", "default"),
    "UsernsMode": ("", "default"),
    "StorageOpt": ("",),
}
"""Further values that mean nothing was said."""
_LISTS = {"CapAdd": "cap_add", "CapDrop": "cap_drop", "GroupAdd": "group_add", "ExtraHosts": "extra_hosts",
          "DeviceCgroupRules": "device_cgroup_rules"}  # fmt: skip


def few(some: list[_T], what: str, subject: str, notes: Notes) -> list[_T]:
    """Return the first of some things, and note where others are left out."""
    if len(some) > MOST_ENTRIES:
        notes.lost(subject, f"of its {what} only {MOST_ENTRIES} of {len(some)} are captured")
    return some[:MOST_ENTRIES]


def host_fields(host: Mapping[str, Any], runtime: str, subject: str, notes: Notes) -> dict[str, Any]:
    """Return the fields of a HostConfig; `runtime` is the engine's default one."""
    found: dict[str, Any] = {}
    for key, name in _LISTS.items():
        if some := few(strings(host.get(key)), name, subject, notes):
            found[name] = [one.removeprefix("CAP_") for one in some] if name.startswith("cap_") else some
    privileged = host.get("Privileged") is True
    if privileged:
        found["privileged"] = True
    # the engine says this one itself of what is privileged
    options = [one for one in strings(host.get("SecurityOpt")) if not (privileged and one == "label=disable")]
    if options:
        found["security_opt"] = few(options, "security_opt", subject, notes)
    if sysctls := string_map(host.get("Sysctls")):
        found["sysctls"] = dict(few(sorted(sysctls.items()), "sysctls", subject, notes))
    if host.get("ReadonlyRootfs") is True:
        found["read_only"] = True
    if isinstance(host.get("Init"), bool):
        found["init"] = host["Init"]
    if (name := string(host.get("Runtime"))) not in ("", runtime):
        found["runtime"] = name
    found |= _namespaces(host, subject, notes) | _limits(host, subject, notes) | _devices(host, subject, notes)
    found |= _restart(host, subject, notes) | _logging(host) | _ports(host, subject, notes)
    for key in sorted(map(str, host))[:200]:
        if key not in _KNOWN and not _nothing(host[key]) and host[key] not in _DEFAULTS.get(key, ()):
            notes.lost(subject, f"{key} is set ({text(str(host[key]), length=80)}): an EDF has no such field")
    return found


def _nothing(value: object) -> bool:
    return value in (None, "", 0, False) or value in ([], {}, ())


def _namespaces(host: Mapping[str, Any], subject: str, notes: Notes) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, name, known in (("IpcMode", "ipc", ("host", "shareable", "none")), ("PidMode", "pid", ("host",))):
        mode = string(host.get(key))
        if mode in known:
            found[name] = mode
        elif mode not in _BOTH:
            notes.lost(subject, f"{key} {text(mode, length=60)}: an EDF cannot say whose namespace it joins")
    return found


def _limits(host: Mapping[str, Any], subject: str, notes: Notes) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, name in (("Memory", "mem_limit"), ("MemoryReservation", "mem_reservation")):
        if size := integer(host.get(key), high=1 << 50):
            found[name] = str(size)
    memory, swap = integer(host.get("Memory")), integer(host.get("MemorySwap"), low=-1)
    if memory and swap != memory:
        notes.adapted(subject, "it may use swap besides its memory; in an EDF `mem_limit` is without swap")
    quota, period = integer(host.get("CpuQuota"), low=-1), integer(host.get("CpuPeriod")) or 100_000
    nano = integer(host.get("NanoCpus"), high=1 << 50)
    if cpus := round(nano / _NS if nano else max(0, quota) / period, 2):
        found["cpus"] = cpus
    if cpuset := string(host.get("CpusetCpus")):
        found["cpuset"] = cpuset
    if (most := integer(host.get("PidsLimit"), low=-1, high=1 << 22)) > 0:
        found["pids_limit"] = most
    if score := integer(host.get("OomScoreAdj"), low=-1000, high=1000):
        found["oom_score_adj"] = score
    if (shm := integer(host.get("ShmSize"), high=1 << 50)) not in (0, _SHM):
        found["shm_size"] = str(shm)
    limits = {}
    for one in mappings(host.get("Ulimits"), most=32):
        soft, hard = (integer(one.get(key), low=-1) for key in ("Soft", "Hard"))
        limits[string(one.get("Name"))] = {"soft": soft, "hard": hard}
    if limits:
        found["ulimits"] = limits
    return found


def _devices(host: Mapping[str, Any], subject: str, notes: Notes) -> dict[str, Any]:
    found: dict[str, Any] = {}
    if devices := [_device(one) for one in few(mappings(host.get("Devices")), "devices", subject, notes)]:
        found["devices"] = devices
    for one in mappings(host.get("DeviceRequests"), most=8):
        groups = one.get("Capabilities")
        names = [name for group in (groups if isinstance(groups, list) else ()) for name in strings(group)]
        count = integer(one.get("Count"), low=-1, high=64)
        if "gpu" in names and not strings(one.get("DeviceIDs")) and count:
            found["gpus"] = "all" if count == -1 else count
        else:
            notes.lost(subject, "asks for certain GPUs or other devices of a driver: an EDF says only how many")
    return found


def _device(one: Mapping[str, Any]) -> str:
    path, inside = string(one.get("PathOnHost")), string(one.get("PathInContainer"))
    rights = string(one.get("CgroupPermissions"))
    if rights not in ("", "rwm"):
        return f"{path}:{inside or path}:{rights}"
    return path if inside in ("", path) else f"{path}:{inside}"


def _restart(host: Mapping[str, Any], subject: str, notes: Notes) -> dict[str, Any]:
    policy = mapping(host.get("RestartPolicy"))
    name, count = string(policy.get("Name")), integer(policy.get("MaximumRetryCount"), high=999_999)
    if host.get("AutoRemove") is True:
        notes.adapted(subject, "it was made with --rm; an EDF's containers stay until they are destroyed")
    if name in ("", "no"):
        return {}
    return {"restart": f"{name}:{count}" if name == "on-failure" and count else name}


def _logging(host: Mapping[str, Any]) -> dict[str, Any]:
    log = mapping(host.get("LogConfig"))
    driver, options = string(log.get("Type")), string_map(log.get("Config"))
    if driver in ("", "json-file") and not options:
        return {}
    return {
        "logging": {"driver": driver or "json-file", **({"options": dict(sorted(options.items()))} if options else {})}
    }


def _ports(host: Mapping[str, Any], subject: str, notes: Notes) -> dict[str, Any]:
    found = []
    for inside, bindings in few(sorted(mapping(host.get("PortBindings")).items()), "ports", subject, notes):
        for one in mappings(bindings, most=8):
            address, published = string(one.get("HostIp")), string(one.get("HostPort"))
            if not may_be_published_at(address):
                plain = ALIKE.get(address)
                if plain is None:
                    notes.lost(subject, f"port {published} is published at {address}: an EDF does at IPv4, or at all")
                    continue
                if plain:  # an engine lists `::` beside 0.0.0.0 itself
                    notes.adapted(subject, f"port {published} is published at {plain}, no longer at {address}")
                address = plain
            port, _, protocol = str(inside).partition("/")
            bare = f"{published or port}:{port}" + (f"/{protocol}" if protocol not in ("", "tcp") else "")
            found.append(f"{address}:{bare}" if address not in ("", "0.0.0.0") else bare)  # noqa: S104 - compared
    return {"ports": list(dict.fromkeys(found))} if found else {}


def health_field(said: object, own: object) -> dict[str, Any]:
    """Return a healthcheck that is not the image's."""
    check = mapping(said)
    if not check or check == mapping(own):
        return {}
    test = strings(check.get("Test"))
    if not test:
        return {}
    found: dict[str, Any] = {"test": test}
    for key, name in (("Interval", "interval"), ("Timeout", "timeout"), ("StartPeriod", "start_period")):
        if nanoseconds := integer(check.get(key), high=86_400 * _NS):
            found[name] = _duration(nanoseconds)
    if retries := integer(check.get("Retries"), high=1000):
        found["retries"] = retries
    return {"healthcheck": {"test": ["NONE"]} if test == ["NONE"] else found}


def _duration(nanoseconds: int) -> str:
    return f"{nanoseconds // _NS}s" if nanoseconds % _NS == 0 else f"{max(1, nanoseconds // 1_000_000)}ms"


def service_name(name: str) -> str:
    """Return a name that a service can have, for anything."""
    plain = re.sub(r"[^a-z0-9_-]+", "-", name.lower())[:50].strip("-_")
    return plain or "service"
