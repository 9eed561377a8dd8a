"""The values that user files become: Inventory, Experiment, Service, ContainerDefinition.

Everything here is validated, merged (a service's fields over its CDF's, a CDF's over the one it extends) and in one
unit (bytes, seconds). Nothing here can read a file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from srprov.definitions.playbookmodel import Playbook
from srprov.definitions.secretmodel import SecretSource, SecretUse
from srprov.errors import Diagnostic, Location
from srprov.secret import Secret

_NOWHERE = Location("")


@dataclass(frozen=True, kw_only=True, slots=True)
class Host:
    """One robot of the inventory, with what srprov reads of its variables."""

    name: str
    address: str
    """`ansible_host`, else the name; ssh_config may map it further."""
    port: int | None = None
    user: str | None = None
    identity_file: str | None = None
    password: Secret | None = None
    become: bool = False
    """`ansible_become`; a user other than root is raised by sudo in any case."""
    become_password: Secret | None = None
    """What sudo is told when it asks."""
    connection: str = "ssh"
    """`ssh` or `local`"""
    ssh_options: tuple[tuple[str, str], ...] = ()
    """`-o` options of `ansible_ssh_common_args` and its kin, names in lower case, in order."""
    tags: tuple[str, ...] = ()
    slots: int | None = None
    underlay: str | None = None
    """Interface or address that other robots reach."""
    devices: tuple[str, ...] = ()
    bandwidth_mbit: float | None = None
    groups: tuple[str, ...] = ()
    location: Location = _NOWHERE


@dataclass(frozen=True, kw_only=True, slots=True)
class Inventory:
    """The lab: hosts by name (sorted), groups by name."""

    hosts: Mapping[str, Host]
    groups: Mapping[str, tuple[str, ...]]
    source: str = ""


@dataclass(frozen=True, kw_only=True, slots=True)
class Requirements:
    """What any robot must have to run a service; compared with totals and presence, never with what is free now."""

    tags: tuple[str, ...] = ()
    devices: tuple[str, ...] = ()
    arch: tuple[str, ...] = ()
    """Docker's names: amd64, arm64, arm."""
    memory: int = 0
    """bytes"""
    cpus: float = 0.0
    gpu: bool = False
    kernel: str = ""
    """A version bound such as `>=5.10`, or empty."""
    disk: int = 0
    """bytes"""


@dataclass(frozen=True, kw_only=True, slots=True)
class HealthCheck:
    """How Docker tells whether a container is healthy; `test` is `("CMD", …)`, `("CMD-SHELL", text)` or `("NONE",)`."""

    test: tuple[str, ...]
    interval_s: float = 30.0
    timeout_s: float = 30.0
    retries: int = 3
    start_period_s: float = 0.0


@dataclass(frozen=True, kw_only=True, slots=True)
class Mount:
    """One volume of a service.

    `kind`: `tree` (a path of the experiment's folder, shipped read-only by content), `bind` (the robot's own path),
    `volume` (a named volume of the instance), `tmpfs`.
    """

    kind: str
    source: str
    """Tree: absolute path on the controller; bind: absolute path on the robot; volume: its bare name; tmpfs: empty."""
    target: str
    read_only: bool = False


@dataclass(frozen=True, kw_only=True, slots=True)
class Runtime:
    """The run-time part of a container, Compose's names, merged from CDF and EDF; empty means the image's own."""

    command: tuple[str, ...] | None = None
    entrypoint: tuple[str, ...] | None = None
    environment: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    working_dir: str = ""
    user: str = ""
    stop_signal: str = ""
    stop_grace_s: float = 10.0
    healthcheck: HealthCheck | None = None
    mounts: tuple[Mount, ...] = ()
    devices: tuple[tuple[str, str, str], ...] = ()
    """(path on the robot, path inside, `rwm`)"""
    ports: tuple[tuple[str, int, int, str], ...] = ()
    """(address or "", published port, container port, `tcp` or `udp`)"""
    ulimits: tuple[tuple[str, int, int], ...] = ()
    """(name, soft, hard)"""
    cap_add: tuple[str, ...] = ()
    privileged: bool = False
    sysctls: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    group_add: tuple[str, ...] = ()
    security_opt: tuple[str, ...] = ()
    device_cgroup_rules: tuple[str, ...] = ()
    tty: bool = False
    shm_size: int = 0
    """bytes"""
    ipc: str = ""
    pid: str = ""
    gpus: str = ""
    """empty, `all`, or a count"""
    restart: str = "no"
    """`no`, `always`, `unless-stopped`, `on-failure` or `on-failure:N`"""
    pull_policy: str = "missing"
    """`missing`, `always` or `never`"""
    job: bool = False


@dataclass(frozen=True, kw_only=True, slots=True)
class BuildFile:
    """One file that a CDF copies into the image; `source` is an absolute path on the controller."""

    source: str
    dest: str
    mode: str = ""
    """Octal text such as `0755`, or empty for the file's own."""


@dataclass(frozen=True, kw_only=True, slots=True)
class ContainerDefinition:
    """One CDF after `extends` was merged. Exactly one of `base`, `image`, `dockerfile` is not empty."""

    name: str
    file: str
    """Absolute path of the CDF."""
    folder: str
    """Folder that relative paths start from."""
    base: str = ""
    image: str = ""
    dockerfile: str = ""
    """Absolute path of a Dockerfile."""
    description: str = ""
    platforms: tuple[str, ...] = ()
    apt: tuple[str, ...] = ()
    pip: tuple[str, ...] = ()
    npm: tuple[str, ...] = ()
    files: tuple[BuildFile, ...] = ()
    run: tuple[str, ...] = ()
    build_environment: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    """`environment` of the CDF: part of the image (ENV)."""
    runtime: Runtime = field(default_factory=Runtime)
    """The CDF's own run-time defaults."""
    requires: Requirements = field(default_factory=Requirements)
    location: Location = _NOWHERE
    lines: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))
    """Line in the CDF of each build field (`base`, `packages.apt`, `run.0`, …): a failed build points there."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Service:
    """One service of the experiment: a CDF or an image, with everything merged."""

    name: str
    cdf: str = ""
    """Key into the containers mapping (absolute path of the CDF); empty when `image` is given."""
    image: str = ""
    cost: float = 10.0
    """The paper's alpha, 0..100."""
    requires: Requirements = field(default_factory=Requirements)
    """CDF's and EDF's together: both must hold."""
    runtime: Runtime = field(default_factory=Runtime)
    """CDF's defaults with the EDF's on top."""
    network: str = "overlay"
    """`overlay`, `host`, `both` or `none`"""
    depends_on: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    """service -> `started`, `healthy` or `completed`"""
    robot: str = ""
    """A pin, or empty."""
    replicas: int = 1
    """How many of it run; more than one become services of their own, see `expand`."""
    per_robot: tuple[str, ...] | None = None
    """Tags: one instance runs on each robot that has them all, and takes no slot. None: an ordinary service."""
    instance_of: str = ""
    """The name in the EDF, when this is one of several instances of it."""
    secrets: tuple[SecretUse, ...] = ()
    location: Location = _NOWHERE


@dataclass(frozen=True, kw_only=True, slots=True)
class Weights:
    """The paper's deltas; they sum to 1."""

    cpu: float = 0.25
    memory: float = 0.25
    swap: float = 0.25
    bandwidth: float = 0.25


@dataclass(frozen=True, kw_only=True, slots=True)
class Placement:
    """How robots are chosen."""

    slots_per_robot: int = 1
    fairness: float = 0.0
    sticky: bool = True
    bandwidth_reference_mbit: float = 1000.0


@dataclass(frozen=True, kw_only=True, slots=True)
class NetworkSettings:
    """What the EDF asks of the overlay; None where srprov decides."""

    subnet: str | None = None
    mtu: int | None = None
    vni: int | None = None
    port: int = 4789


@dataclass(frozen=True, kw_only=True, slots=True)
class Pool:
    """Services that may run together on one robot, in one slot, at the discounted sum of their costs; or apart."""

    name: str
    """As given, else its services joined by `+`."""
    services: tuple[str, ...]
    """In name order."""
    discount: float = 1.0
    """Their summed cost is multiplied by this when they run together; more than 0, at most 1."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Experiment:
    """One EDF, with services in name order."""

    name: str
    file: str
    """Absolute path of the EDF."""
    folder: str
    services: Mapping[str, Service]
    secrets: Mapping[str, SecretSource] = field(default_factory=lambda: MappingProxyType({}))
    playbooks: tuple[Playbook, ...] = ()
    """Those that come with the EDF, in its order."""
    same_robot: tuple[tuple[str, ...], ...] = ()
    different_robot: tuple[tuple[str, ...], ...] = ()
    """Groups of which no two services run on one robot."""
    pools: tuple[Pool, ...] = ()
    weights: Weights = field(default_factory=Weights)
    placement: Placement = field(default_factory=Placement)
    network: NetworkSettings = field(default_factory=NetworkSettings)
    description: str = ""
    authors: tuple[str, ...] = ()
    metadata: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))


@dataclass(frozen=True, kw_only=True, slots=True)
class Definitions:
    """All that was read. `unsupported` lists what validates but is not built yet: plan and apply refuse it."""

    experiment: Experiment
    containers: Mapping[str, ContainerDefinition]
    unsupported: tuple[Diagnostic, ...] = ()
