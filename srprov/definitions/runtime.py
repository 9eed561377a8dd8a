"""A merged layer -> Runtime.

Takes a map in normal form (`merging.normalise`) whose shape the schema has checked; gives typed values in one unit.
Touches the file system for looking, through `mounts`. Problems point at the file that the value comes from.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Protocol, TypeVar

from msgspec.structs import replace

from srprov.codes import Code
from srprov.definitions import merging, mounts, ports, values
from srprov.definitions.container_words import lengths, too_much
from srprov.definitions.containermodel import HealthCheck, Logging, Runtime
from srprov.definitions.hostnames import extra_hosts
from srprov.definitions.values import Device, flag, guarded, text, text_map, texts
from srprov.names import label_fault
from srprov.yamldoc import nodes
from srprov.yamldoc.fields import size_in_bytes
from srprov.yamldoc.nodes import Findings, Map, Node, Path, Scalar

RUNTIME_FIELDS = merging.RUNTIME_MERGED | {
    *("command", "entrypoint", "working_dir", "user", "stop_signal", "stop_grace_period", "privileged", "tty", "job"),
    *("mem_limit", "cpus", "pids_limit", "shm_size", "ipc", "pid", "gpus", "restart", "pull_policy"),
    *(
        "mem_reservation",
        "oom_score_adj",
        "cpuset",
        "stdin_open",
        "init",
        "read_only",
        "hostname",
        "logging",
        "runtime",
    ),
}
_T = TypeVar("_T")
_MOST_GPUS = 999_999


def parse(layer: Map, folder: str, findings: Findings, path: Path, *, init: bool | None = None) -> Runtime:
    """Read the run-time fields; `folder` is the experiment's, `path` where the layer stands in its document.

    `init` is what counts where nothing is said of it.
    """
    found = _read(layer, folder, findings, path, init=init)
    _check_length(found, layer, findings, path)
    return found


def _read(layer: Map, folder: str, findings: Findings, path: Path, *, init: bool | None) -> Runtime:
    get = layer.entries.get

    def read(key: str, reader: Callable[[Node], _T], default: _T) -> _T:
        node = get(key)
        return default if node is None else guarded(reader, node, default, findings, (*path, key))

    return replace(
        _limits(get, read),
        command=read("command", values.container_words, None),
        entrypoint=read("entrypoint", values.container_words, None),
        environment=text_map(get("environment")),
        working_dir=text(get("working_dir")),
        user=text(get("user")),
        stop_signal=text(get("stop_signal")),
        stop_grace_s=read("stop_grace_period", lambda node: values.duration(text(node)), 10.0),
        healthcheck=healthcheck(get("healthcheck"), findings, (*path, "healthcheck")),
        mounts=mounts.parse(get("volumes"), get("tmpfs"), get("data"), folder, findings, path),
        devices=_devices(get("devices")),
        ports=ports.published(get("ports"), findings, (*path, "ports")),
        expose=ports.exposed(get("expose"), findings, (*path, "expose")),
        ulimits=_ulimits(get("ulimits"), findings, (*path, "ulimits")),
        cap_add=texts(get("cap_add")),
        cap_drop=texts(get("cap_drop")),
        privileged=flag(get("privileged")),
        sysctls=text_map(get("sysctls")),
        group_add=texts(get("group_add")),
        security_opt=texts(get("security_opt")),
        device_cgroup_rules=texts(get("device_cgroup_rules")),
        tty=flag(get("tty")),
        stdin_open=flag(get("stdin_open")),
        init=flag(get("init")) if "init" in layer.entries else init,
        read_only=flag(get("read_only")),
        hostname=text(get("hostname")),
        extra_hosts=extra_hosts(get("extra_hosts"), findings, (*path, "extra_hosts")),
        labels=_labels(get("labels"), findings, (*path, "labels")),
        logging=_logging(get("logging")),
        restart=text(get("restart"), "no"),
        pull_policy=text(get("pull_policy"), "missing").replace("if_not_present", "missing"),
        job=flag(get("job")),
    )


def _check_length(found: Runtime, layer: Map, findings: Findings, path: Path) -> None:
    """Check that an engine can tell what there is of a container in an answer that is read: some of it twice."""
    said = lengths(found)
    if wrong := too_much(said):
        key = max(said, key=lambda one: said[one])
        hint = "put what is long into a file"
        findings.add(nodes.key_or_value(layer, key), wrong, (*path, key), hint, code=Code.TOO_LARGE)


class _Reader(Protocol):
    def __call__(self, key: str, reader: Callable[[Node], _T], default: _T) -> _T:
        """Return what a field says, or the default where nothing stands, or what stands there is wrong."""


def _limits(get: Callable[[str], Node | None], read: _Reader) -> Runtime:
    """Return what a container may use of the robot, and which of its namespaces it is in."""

    def size(node: Node) -> int:
        return size_in_bytes(text(node))

    def number(node: Node) -> float:
        assert isinstance(node, Scalar)
        return nodes.as_number(node) or 0.0

    def count(node: Node) -> str:
        whole = nodes.as_int(node)  # 0x1F, too
        if whole is not None and whole > _MOST_GPUS:
            raise ValueError(f"'{whole}' is more than {_MOST_GPUS}")
        return text(node) if whole is None else str(whole)

    def reservation(node: Node) -> int:
        if limit and size(node) > limit:
            raise ValueError("is more than 'mem_limit'")
        return size(node)

    limit = read("mem_limit", size, 0)
    return Runtime(
        mem_limit=limit,
        mem_reservation=read("mem_reservation", reservation, 0),
        oom_score_adj=int(read("oom_score_adj", number, 0.0)),
        cpus=read("cpus", number, 0.0),
        cpuset=text(get("cpuset")),
        pids_limit=int(read("pids_limit", number, 0.0)),
        shm_size=read("shm_size", size, 0),
        ipc=text(get("ipc")),
        pid=text(get("pid")),
        gpus=read("gpus", count, ""),
        runtime=text(get("runtime")),
    )


def healthcheck(node: Node | None, findings: Findings, path: Path) -> HealthCheck | None:
    """Read one healthcheck; a switched-off one is `("NONE",)`, one without a test that of the image."""
    if not isinstance(node, Map):
        return None
    get = node.entries.get
    if flag(get("disable")):
        return HealthCheck(test=("NONE",))
    test = get("test")
    words: tuple[str, ...] = ()
    if test is not None:
        words = ("CMD-SHELL", text(test)) if isinstance(test, Scalar) else texts(test)
        wrong = words[0] not in ("CMD", "CMD-SHELL", "NONE") or (words[0] == "CMD-SHELL" and len(words) != 2)
        if wrong or (words[0] == "NONE") != (len(words) == 1):
            findings.add(
                test,
                "a healthcheck's list is [CMD, word…], [CMD-SHELL, text] or [NONE]",
                (*path, "test"),
                code=Code.WRONG_VALUE,
            )
            return None
    retries = nodes.as_int(node.entries["retries"]) if "retries" in node.entries else None

    def seconds(key: str, default: float) -> float:
        given = get(key)
        read: Callable[[Node], float] = lambda node: values.duration(text(node))  # noqa: E731 - too small for a name
        usual = default if words else 0.0
        return usual if given is None else guarded(read, given, usual, findings, (*path, key))

    return HealthCheck(
        test=words,
        interval_s=seconds("interval", 30.0),
        timeout_s=seconds("timeout", 30.0),
        retries=retries or (3 if words else 0),
        start_period_s=seconds("start_period", 0.0),
    )


def _labels(node: Node | None, findings: Findings, path: Path) -> Mapping[str, str]:
    found = text_map(node)
    for name in found:
        assert isinstance(node, Map)
        if wrong := label_fault(name):
            findings.add(
                node.keys[name],
                wrong,
                (*path, name),
                "take another name",
                code=Code.NAME,
            )
    return found


def _logging(node: Node | None) -> Logging | None:
    if not isinstance(node, Map):
        return None
    return Logging(driver=text(node.entries.get("driver")), options=text_map(node.entries.get("options")))


def _devices(node: Node | None) -> tuple[Device, ...]:
    by_inside = {spec[1]: spec for spec in map(values.device, texts(node))}
    return tuple(by_inside.values())


def _ulimits(node: Node | None, findings: Findings, path: Path) -> tuple[tuple[str, int, int], ...]:
    limits = []
    for name, value in node.entries.items() if isinstance(node, Map) else ():
        both_ends = [value.entries.get("soft"), value.entries.get("hard")] if isinstance(value, Map) else [value, value]
        soft, hard = (nodes.as_int(end) or 0 if end is not None else 0 for end in both_ends)
        if hard != -1 and (soft > hard or soft == -1):
            findings.add(
                value, f"the soft limit {soft} is above the hard limit {hard}", (*path, name), code=Code.WRONG_VALUE
            )
        limits.append((name, soft, hard))
    return tuple(limits)
