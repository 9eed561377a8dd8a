"""The run-time part of a container in Compose's words. Pure.

Takes a Runtime; gives the keys of a Compose service. What names another thing of the experiment (mounts, networks,
secrets, dependencies) is made elsewhere. The result is what srprov tells the engine, so some defaults of srprov's are
written out: no swap beside `mem_limit`, for one.

Source: Compose specification, "Services top-level elements"; what the engine is told: `modules/container_body.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from srprov.definitions.containermodel import HealthCheck, Port, Runtime

_GRACE_S = 10.0
"""Compose's default, as it is ours."""
_AS_IT_IS = (
    *("working_dir", "user", "stop_signal", "cap_add", "cap_drop", "privileged", "sysctls", "group_add"),
    *("security_opt", "device_cgroup_rules", "tty", "stdin_open", "read_only", "labels"),
    *("mem_reservation", "oom_score_adj", "cpus", "cpuset", "pids_limit", "shm_size", "ipc", "pid", "runtime"),
)
"""Fields that have the same name and form."""


def runtime_document(run: Runtime) -> dict[str, Any]:
    """Return the keys of a service that its Runtime alone decides, without those that Compose has by default."""
    plain = {name: _json(getattr(run, name)) for name in _AS_IT_IS}
    log = run.logging
    given: dict[str, Any] = {
        **plain,
        "stop_grace_period": duration(run.stop_grace_s) if run.stop_grace_s != _GRACE_S else "",
        "healthcheck": _healthcheck(run.healthcheck) if run.healthcheck else None,
        "devices": [":".join(one) for one in run.devices],
        "expose": [f"{port}/{protocol}" for port, protocol in run.expose],
        "ulimits": {name: {"soft": soft, "hard": hard} for name, soft, hard in run.ulimits},
        "logging": _with_values({"driver": log.driver, "options": dict(log.options)}) if log else None,
        "mem_limit": run.mem_limit,
        "memswap_limit": run.mem_limit,
        "deploy": _gpus(run) if run.gpus else None,
        "restart": run.restart if run.restart != "no" else "",
        "pull_policy": run.pull_policy if run.pull_policy != "missing" else "",
    }
    words = {"command": run.command, "entrypoint": run.entrypoint}
    # an empty list takes the image's away, and is no default
    found = {name: list(one) for name, one in words.items() if one is not None}
    return {**found, **_with_values(given), **({"init": run.init} if run.init is not None else {})}


def port_documents(ports: Sequence[Port]) -> list[dict[str, Any]]:
    """Return published ports in the long form."""
    return [
        _with_values({"target": inside, "published": str(published), "host_ip": address, "protocol": protocol})
        for address, published, inside, protocol in ports
    ]


def duration(seconds: float) -> str:
    """Return a time as both EDF and Compose read it, to the microsecond."""
    micros = round(seconds * 1e6)
    for unit, factor in (("s", 1_000_000), ("ms", 1000)):
        if micros % factor == 0:
            return f"{micros // factor}{unit}"
    return f"{micros}us"


def _healthcheck(check: HealthCheck) -> dict[str, Any]:
    if check.test == ("NONE",):
        return {"disable": True}
    return {
        "test": list(check.test),
        "interval": duration(check.interval_s),
        "timeout": duration(check.timeout_s),
        "retries": check.retries,
        "start_period": duration(check.start_period_s),
    }


def _gpus(run: Runtime) -> dict[str, Any]:
    count = run.gpus if run.gpus == "all" else int(run.gpus)
    # Compose refuses a `mem_reservation` that does not stand beside them too
    memory = {"memory": str(run.mem_reservation)} if run.mem_reservation else {}
    return {"resources": {"reservations": {**memory, "devices": [{"count": count, "capabilities": ["gpu"]}]}}}


def _json(value: Any) -> Any:  # noqa: ANN401 - whatever a field has
    if isinstance(value, tuple):
        return list(value)
    return dict(value) if hasattr(value, "items") else value


def _with_values(given: dict[str, Any]) -> dict[str, Any]:
    """Leave out what says nothing: no text, no list, zero, false."""
    return {key: value for key, value in given.items() if value}
