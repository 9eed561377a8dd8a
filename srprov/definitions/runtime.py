"""A merged layer -> Runtime and Requirements.

Takes a map in normal form (`merging.normalise`) whose shape the schema has checked; gives typed values in one unit.
Touches the file system for looking, through `mounts`. Problems point at the file that the value comes from.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from srprov.definitions import merging, mounts, values
from srprov.definitions.containermodel import HealthCheck, Port, Requirements, Runtime, ports_meet
from srprov.definitions.values import Device, scalars, text, text_map, texts
from srprov.yamldoc import nodes
from srprov.yamldoc.fields import size_in_bytes
from srprov.yamldoc.nodes import Findings, Map, Node, Path, Scalar

RUNTIME_FIELDS = merging.RUNTIME_MERGED | {
    *("command", "entrypoint", "working_dir", "user", "stop_signal", "stop_grace_period", "privileged", "tty", "job"),
    *("mem_limit", "cpus", "pids_limit", "shm_size", "ipc", "pid", "gpus", "restart", "pull_policy"),
}
_T = TypeVar("_T")


def parse(layer: Map, folder: str, findings: Findings, path: Path) -> Runtime:
    """Read the run-time fields; `folder` is the experiment's, `path` where the layer stands in its document."""
    get = layer.entries.get

    def read(key: str, reader: Callable[[Node], _T], default: _T) -> _T:
        node = get(key)
        return default if node is None else _guarded(reader, node, default, findings, (*path, key))

    return Runtime(
        command=read("command", values.command_words, None),
        entrypoint=read("entrypoint", values.command_words, None),
        environment=text_map(get("environment")),
        working_dir=text(get("working_dir")),
        user=text(get("user")),
        stop_signal=text(get("stop_signal")),
        stop_grace_s=read("stop_grace_period", lambda node: values.duration(text(node)), 10.0),
        healthcheck=healthcheck(get("healthcheck"), findings, (*path, "healthcheck")),
        mounts=mounts.parse(get("volumes"), folder, findings, (*path, "volumes")),
        devices=_devices(get("devices")),
        ports=_ports(get("ports"), findings, (*path, "ports")),
        expose=_exposed(get("expose"), findings, (*path, "expose")),
        ulimits=_ulimits(get("ulimits"), findings, (*path, "ulimits")),
        cap_add=texts(get("cap_add")),
        privileged=_flag(get("privileged")),
        sysctls=text_map(get("sysctls")),
        group_add=texts(get("group_add")),
        security_opt=texts(get("security_opt")),
        device_cgroup_rules=texts(get("device_cgroup_rules")),
        tty=_flag(get("tty")),
        mem_limit=read("mem_limit", lambda node: size_in_bytes(text(node)), 0),
        cpus=(nodes.as_number(layer.entries["cpus"]) if "cpus" in layer.entries else 0.0) or 0.0,
        pids_limit=(nodes.as_int(layer.entries["pids_limit"]) if "pids_limit" in layer.entries else 0) or 0,
        shm_size=read("shm_size", lambda node: size_in_bytes(text(node)), 0),
        ipc=text(get("ipc")),
        pid=text(get("pid")),
        gpus=text(get("gpus")),
        restart=text(get("restart"), "no"),
        pull_policy=text(get("pull_policy"), "missing"),
        job=_flag(get("job")),
    )


def requirements(node: Node | None, findings: Findings, path: Path) -> Requirements:
    """Read one `requires`."""
    entries = node.entries if isinstance(node, Map) else {}
    get: Callable[[str], Any] = entries.get

    def size(key: str) -> int:
        given = get(key)
        return 0 if given is None else _guarded(lambda n: size_in_bytes(text(n)), given, 0, findings, (*path, key))

    cpus = nodes.as_number(entries["cpus"]) if "cpus" in entries else 0.0
    version = text(get("kernel")).removeprefix(">=").strip()
    return Requirements(
        tags=tuple(dict.fromkeys(texts(get("tags")))),
        devices=tuple(dict.fromkeys(texts(get("devices")))),
        arch=tuple(_ARCH.get(name, name) for name in texts(get("arch"))),
        memory=size("memory"),
        cpus=cpus or 0.0,
        gpu=_flag(get("gpu")),
        kernel=f">={version}" if version else "",
        disk=size("disk"),
    )


_ARCH = {"x86_64": "amd64", "aarch64": "arm64", "armv7l": "arm", "armv6l": "arm", "armhf": "arm"}


def combined(one: Requirements, other: Requirements) -> Requirements:
    """Return the requirements of which each robot must meet both.

    Raises:
        ValueError: They name architectures, and none in common.
    """
    arch = tuple(name for name in one.arch if name in other.arch) if one.arch and other.arch else one.arch or other.arch
    if (one.arch or other.arch) and not arch:
        raise ValueError(f"'{', '.join(other.arch)}' has nothing in common with the CDF's '{', '.join(one.arch)}'")
    return Requirements(
        tags=tuple(dict.fromkeys(one.tags + other.tags)),
        devices=tuple(dict.fromkeys(one.devices + other.devices)),
        arch=arch,
        memory=max(one.memory, other.memory),
        cpus=max(one.cpus, other.cpus),
        gpu=one.gpu or other.gpu,
        kernel=max(one.kernel, other.kernel, key=_version),
        disk=max(one.disk, other.disk),
    )


def _version(bound: str) -> tuple[int, ...]:
    return tuple(int(part) for part in bound.removeprefix(">=").split(".") if part)


def healthcheck(node: Node | None, findings: Findings, path: Path) -> HealthCheck | None:
    """Read one healthcheck; a switched-off one is `("NONE",)`."""
    if not isinstance(node, Map):
        return None
    get = node.entries.get
    test, disabled = get("test"), _flag(get("disable"))
    if disabled:
        return HealthCheck(test=("NONE",))
    if test is None:
        findings.add(node, "the healthcheck has no 'test'", path, "give the command, e.g. test: rostopic list")
        return None
    words = ("CMD-SHELL", text(test)) if isinstance(test, Scalar) else texts(test)
    wrong = words[0] not in ("CMD", "CMD-SHELL", "NONE") or (words[0] == "CMD-SHELL" and len(words) != 2)
    if wrong or (words[0] == "NONE") != (len(words) == 1):
        findings.add(test, "a healthcheck's list is [CMD, word…], [CMD-SHELL, text] or [NONE]", (*path, "test"))
        return None
    retries = nodes.as_int(node.entries["retries"]) if "retries" in node.entries else 3

    def seconds(key: str, default: float) -> float:
        given = get(key)
        read: Callable[[Node], float] = lambda node: values.duration(text(node))  # noqa: E731 - too small for a name
        return default if given is None else _guarded(read, given, default, findings, (*path, key))

    return HealthCheck(
        test=words,
        interval_s=seconds("interval", 30.0),
        timeout_s=seconds("timeout", 30.0),
        retries=retries or 3,
        start_period_s=seconds("start_period", 0.0),
    )


def _guarded(reader: Callable[[Node], _T], node: Node, default: _T, findings: Findings, path: Path) -> _T:
    try:
        return reader(node)
    except ValueError as error:
        findings.add(node, str(error), path)
        return default


def _flag(node: Node | None) -> bool:
    return node is not None and bool(nodes.as_bool(node))


def _devices(node: Node | None) -> tuple[Device, ...]:
    by_inside = {spec[1]: spec for spec in map(values.device, texts(node))}
    return tuple(by_inside.values())


def _ports(node: Node | None, findings: Findings, path: Path) -> tuple[Port, ...]:
    taken: dict[tuple[int, str], list[tuple[Port, Node]]] = {}
    every: list[Port] = []
    none: tuple[Port, ...] = ()
    for item in scalars(node):
        for port in _guarded(lambda given: values.ports(text(given)), item, none, findings, path):
            others = taken.setdefault((port[1], port[3]), [])
            first = next((place for other, place in others if ports_meet(port, other)), None)
            if first is not None:
                message = f"port {port[1]}/{port[3]} is published twice; already on line {first.line}"
                findings.add(item, message, path)
                break
            others.append((port, item))
            every.append(port)
            if len(every) > values.MOST_PORTS:
                findings.add(item, f"more than {values.MOST_PORTS} ports are published", path)
                return none
    return tuple(every)


def _exposed(node: Node | None, findings: Findings, path: Path) -> tuple[tuple[int, str], ...]:
    none: tuple[tuple[int, str], ...] = ()
    found = [_guarded(lambda given: values.exposed(text(given)), item, none, findings, path) for item in scalars(node)]
    return tuple(dict.fromkeys(port for ports in found for port in ports))


def _ulimits(node: Node | None, findings: Findings, path: Path) -> tuple[tuple[str, int, int], ...]:
    limits = []
    for name, value in node.entries.items() if isinstance(node, Map) else ():
        both_ends = [value.entries.get("soft"), value.entries.get("hard")] if isinstance(value, Map) else [value, value]
        soft, hard = (nodes.as_int(end) or 0 if end is not None else 0 for end in both_ends)
        if hard != -1 and (soft > hard or soft == -1):
            findings.add(value, f"the soft limit {soft} is above the hard limit {hard}", (*path, name))
        limits.append((name, soft, hard))
    return tuple(limits)
