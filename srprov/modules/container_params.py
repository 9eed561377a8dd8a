"""What a playbook says of a container: Compose's words, merged from CDF and EDF, and its place in the network."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from srprov.modules.params import ParameterError


@dataclass(frozen=True, kw_only=True, slots=True)
class HealthCheck:
    """How the engine tells whether the container is healthy."""

    test: tuple[str, ...]
    interval_s: float
    timeout_s: float
    retries: int
    start_period_s: float


@dataclass(frozen=True, kw_only=True, slots=True)
class RunParams:
    """The run-time fields; empty means the image's own."""

    command: tuple[str, ...] | None
    entrypoint: tuple[str, ...] | None
    environment: Mapping[str, str]
    working_dir: str
    user: str
    stop_signal: str
    stop_grace_s: float
    healthcheck: HealthCheck | None
    devices: tuple[tuple[str, str, str], ...]
    """(path on the robot, path inside, `rwm`)"""
    ports: tuple[tuple[str, int, int, str], ...]
    """(address or "", published port, container port, `tcp` or `udp`)"""
    ulimits: tuple[tuple[str, int, int], ...]
    """(name, soft, hard)"""
    cap_add: tuple[str, ...]
    privileged: bool
    sysctls: Mapping[str, str]
    group_add: tuple[str, ...]
    security_opt: tuple[str, ...]
    device_cgroup_rules: tuple[str, ...]
    tty: bool
    shm_size: int
    """bytes"""
    ipc: str
    pid: str
    gpus: str
    """empty, `all`, or a count"""
    restart: str
    """`no`, `always`, `unless-stopped`, `on-failure` or `on-failure:N`"""
    pull_policy: str
    """Not the container's, but its image's."""
    job: bool
    """As the parameter of the same name."""

    def __post_init__(self) -> None:
        """Refuse counts that are no numbers."""
        count = self.restart.partition(":")[2]
        for field, text in (("gpus", "" if self.gpus == "all" else self.gpus), ("restart", count)):
            if text and not (text.isascii() and text.removeprefix("-").isdigit()):
                raise ParameterError("run", f"run.{field}: {text!r} is no number")


@dataclass(frozen=True, kw_only=True, slots=True)
class NetworkPlace:
    """Where the container is in the network; all but the mode are for `overlay` only."""

    mode: Literal["overlay", "host", "none"]
    name: str | None = None
    ip: str | None = None
    mac: str | None = None
    hash: str | None = None
    """Of what it depends on in the network."""

    def __post_init__(self) -> None:
        """Refuse an overlay without an address."""
        if self.mode == "overlay" and None in (self.name, self.ip, self.mac):
            raise ParameterError("network", "network: an overlay needs 'name', 'ip' and 'mac'")


@dataclass(frozen=True, kw_only=True, slots=True)
class ContainerParams:
    """What a playbook says of a container."""

    instance: str
    source: str
    service: str
    image: str
    hostname: str
    job: bool
    """It ends by itself."""
    run: RunParams
    mounts: tuple[Mapping[str, Any], ...]
    """In the engine's form."""
    network: NetworkPlace
    api: str
    """The version of the engine's API."""

    def __post_init__(self) -> None:
        """Refuse mounts that the engine could not read."""
        for mount in self.mounts:
            if not (isinstance(mount.get("Type"), str) and isinstance(mount.get("Target"), str)):
                raise ParameterError("mounts", "mounts: each needs 'Type' and 'Target'")
