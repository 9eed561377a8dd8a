"""A finished tree -> what Compose prints of it: typed values, and no key whose value says nothing. Pure."""

from __future__ import annotations

from collections.abc import Mapping

from srprov.importing.compose import printers
from srprov.importing.compose.check import alternatives
from srprov.importing.compose.printers import Printer
from srprov.importing.compose.shapes_more import ALL_TABLES
from srprov.importing.compose.values import Value
from srprov.importing.position import Path

_PRINTERS: Mapping[Printer, str] = {
    printers.size: """service.mem_limit service.mem_reservation service.mem_swappiness service.memswap_limit
        service.shm_size
        build.shm_size limits.memory reservations.memory tmpfs.size rate.rate""",
    printers.duration: """service.stop_grace_period healthcheck.interval healthcheck.timeout healthcheck.start_period
        healthcheck.start_interval restart_policy.delay restart_policy.window""",
    printers.some_duration: "update.delay update.monitor",
    printers.fraction: "service.cpus service.cpu_percent limits.cpus reservations.cpus update.max_failure_ratio",
    printers.counted: """healthcheck.retries update.parallelism restart_policy.max_attempts
        placement.max_replicas_per_node
        weight.weight blkio.weight""",
    printers.bare: "tmpfs.mode",
    printers.whole: """service.cpu_count service.cpu_period service.cpu_quota service.cpu_rt_period
        service.cpu_rt_runtime
        service.cpu_shares service.oom_score_adj service.pids_limit service.scale deploy.replicas limits.pids
        port.target attachment.priority attachment.gw_priority discrete.value""",
    printers.flag: """service.attach service.init service.oom_kill_disable service.privileged service.read_only
        service.stdin_open service.tty service.use_api_socket build.no_cache build.privileged build.pull
        dependency.restart dependency.required env_file.required mount.read_only bind.create_host_path
        mounted_volume.nocopy hook.privileged healthcheck.disable watch.initial_sync network.internal
        network.attachable
        network.enable_ipv4 network.enable_ipv6 network.external volume.external secret.external config.external""",
    printers.any_text: "port.published build.provenance build.sbom",
    printers.mode: "mounted.mode",
    printers.device_count: "device_request.count gpu.count",
    printers.command: "service.command service.entrypoint hook.command",
    printers.test: "healthcheck.test",
    printers.pairs: """service.annotations service.labels service.sysctls build.labels build.args
        build.additional_contexts deploy.labels mounted_volume.labels device_request.options gpu.options
        logging.options attachment.driver_opts network.driver_opts network.labels volume.driver_opts volume.labels
        secret.labels secret.driver_opts config.labels ipam.options subnet.aux_addresses""",
    printers.strict_pairs: "service.storage_opt",
    printers.open_pairs: "service.environment hook.environment",
    printers.hosts: "service.extra_hosts build.extra_hosts",
    printers.ulimits: "service.ulimits build.ulimits",
    printers.texts: """service.expose service.group_add service.tmpfs service.dns_search service.dns
        service.label_file watch.ignore watch.include""",
}
PRINTERS: Mapping[str, Printer] = {field: printer for printer, fields in _PRINTERS.items() for field in fields.split()}
_KEPT = """service.command service.entrypoint service.attach service.init service.scale service.healthcheck
    service.deploy service.logging service.build service.stop_grace_period service.develop
    service.blkio_config     dependency.required env_file.required healthcheck.retries
    deploy.replicas deploy.resources deploy.placement
    deploy.update_config deploy.rollback_config deploy.restart_policy resources.limits resources.reservations
    update.parallelism restart_policy.max_attempts mount.bind mount.volume mount.tmpfs mount.image
    network.ipam network.enable_ipv4 network.enable_ipv6 project.services generic.discrete_resource_spec"""
KEPT = frozenset(_KEPT.split())
"""Fields that are printed even when they say nothing."""
_COMMANDS = ("command", "entrypoint")
"""None at all is another thing than an empty one."""
ALWAYS: Mapping[str, tuple[tuple[str, object], ...]] = {
    "service": (("command", None), ("entrypoint", None)),
    "deploy": (("resources", {}), ("placement", {})),
    "network": (("ipam", {}),),
}
"""Fields that are printed even when they were never written."""


def printed(value: Value, table: str, path: Path = ()) -> Value:
    """Return a map as Compose prints it; `table` is the name of its table of shapes.

    Raises:
        Refused: A value cannot be read as what its key wants.
    """
    keys = ALL_TABLES[table]
    entries: dict[str, Value] = {}
    for name, item in value.data.items():
        if name not in keys:
            entries[name] = item
            continue
        made = _field(item, f"{table}.{name}", keys[name], (*path, name))
        if not _says_nothing(made) or (f"{table}.{name}" in KEPT and (made.data is not None or name in _COMMANDS)):
            entries[name] = made
    for name, data in ALWAYS.get(table, ()):
        entries.setdefault(name, Value(data, value.place))
    return value.of(entries)


def _field(value: Value, field: str, kind: str, path: Path) -> Value:
    if value.data is None and path[-1] not in _COMMANDS:
        return value
    if printer := PRINTERS.get(field):
        return value.of(printer(value, path))
    return _by_kind(value, kind, path)


def _by_kind(value: Value, kind: str, path: Path) -> Value:
    """Print what is in lists and maps by their kinds."""
    data = value.data
    if not isinstance(data, dict | list):
        return value
    for one in alternatives(kind):
        if one[0] == "@" and isinstance(data, dict):
            return printed(value, one[1:], path)
        if one[0] in "{<" and isinstance(data, dict):
            return value.of({name: _by_kind(item, one[1:-1], (*path, name)) for name, item in data.items()})
        if one[0] == "[" and isinstance(data, list):
            inner = one.removesuffix("!")[1:-1]
            return value.of([_by_kind(item, inner, (*path, number)) for number, item in enumerate(data)])
    return value


def _says_nothing(value: Value) -> bool:
    return (
        value.data is None
        or (not isinstance(value.data, float) and value.data in ("", 0, False, [], {}))
        or value.data == 0
    )
