"""The values of one container: a CDF, and what it needs of a robot and of Docker to run."""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import MappingProxyType

import msgspec

from srprov.errors import Location

_NOWHERE = Location("")
TMPFS_OPTIONS = re.compile(
    r"((rw|ro|(no)?(exec|suid|dev|atime|diratime)|relatime|strictatime|size=[0-9]+[kmgKMG%]?|mode=[0-7]{3,4}"
    r"|(uid|gid)=[0-9]{1,10}|nr_inodes=[0-9]+[kmgKMG]?)(,(?!\Z)|\Z))*"
)
"""What may stand behind a tmpfs, as mount(8) has it."""

Port = tuple[str, int, int, str]
"""(address or "", published port, container port, `tcp` or `udp`)"""
EVERYWHERE = ("", "0.0.0.0", "::")  # noqa: S104 - compared with, never bound to
"""Addresses that stand for all of a robot's."""

LINK_PORTS = range(768, 1024)
"""UDP ports that overlays' links send from: the engine's proxy of one would send a container's words to anybody."""
TUNNEL_PORTS = range(20_000, 30_000)  # UDP, of interfaces that encrypt overlays: even ones of each `a`, odd ones of `b`
VXLAN_PORT = 4789  # of overlays that name none: who publishes it gets what members send while no link is there


def of_links(port: Port) -> bool:
    """Return whether a published port is one that the links of overlays send from, or are sent to."""
    return port[3] == "udp" and (port[1] in LINK_PORTS or port[1] == VXLAN_PORT)


def ports_meet(one: Port, other: Port) -> bool:
    """Return whether two published ports cannot be had on one robot at the same time."""
    same = one[0] == other[0] or one[0] in EVERYWHERE or other[0] in EVERYWHERE
    return same and (one[1], one[3]) == (other[1], other[3])


class Requirements(msgspec.Struct, frozen=True, kw_only=True):
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
    wireguard: bool = False
    """Its overlay is encrypted: of the EDF's `network`, not of `requires`."""


class HealthCheck(msgspec.Struct, frozen=True, kw_only=True):
    """How Docker tells whether a container is healthy; `test` is `("CMD", …)`, `("CMD-SHELL", text)` or `("NONE",)`.

    An empty test is the image's own; a time or a count of 0 is then the image's too.
    """

    test: tuple[str, ...]
    interval_s: float = 30.0
    timeout_s: float = 30.0
    retries: int = 3
    start_period_s: float = 0.0


class Seed(msgspec.Struct, frozen=True, kw_only=True):
    """What a volume holds when it is made."""

    path: str
    """Absolute, of a folder on the controller."""
    user: str = ""
    """Whose it is in the volume: `UID` or `UID:GID`; empty: root's."""


class Mount(msgspec.Struct, frozen=True, kw_only=True):
    """One volume of a service.

    `kind`: `tree` (a path of the experiment's folder, shipped read-only by content), `bind` (the robot's own path),
    `volume` (a named volume of the instance), `tmpfs`, `data` (a data set: a file that is shipped read-only, once).
    """

    kind: str
    source: str
    """Tree and data: absolute path on the controller; bind: absolute path on the robot, or `~USER/…` until it is known
    which robot; volume: its bare name; else empty."""
    target: str
    read_only: bool = False
    create_host_path: bool = False
    """Of a bind: make the folder on the robot where there is nothing."""
    options: str = ""
    """Of a tmpfs: mount options such as `size=64m,mode=1777`."""
    sha256: str = ""
    """Of a data set: what its file must have; empty: whatever it has."""
    url: str = ""
    """Of a data set: where it is downloaded, when it has no source."""
    seed: Seed | None = None
    """Of a volume: what it holds when it is made."""

    @property
    def home_of(self) -> str:
        """Return the user of the robot in whose home the source lies; empty where it is an absolute path."""
        return self.source[1:].partition("/")[0] if self.kind == "bind" and self.source.startswith("~") else ""


class Logging(msgspec.Struct, frozen=True, kw_only=True):
    """Where the engine puts what a container prints."""

    driver: str = ""
    """Empty: the engine's default."""
    options: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))


class Runtime(msgspec.Struct, frozen=True, kw_only=True):
    """The run-time part of a container, Compose's names, merged from CDF and EDF; empty means the image's own."""

    command: tuple[str, ...] | None = None
    entrypoint: tuple[str, ...] | None = None
    environment: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    working_dir: str = ""
    user: str = ""
    stop_signal: str = ""
    stop_grace_s: float = 10.0
    healthcheck: HealthCheck | None = None
    mounts: tuple[Mount, ...] = ()
    devices: tuple[tuple[str, str, str], ...] = ()
    """(path on the robot, path inside, `rwm`)"""
    ports: tuple[Port, ...] = ()
    expose: tuple[tuple[int, str], ...] = ()
    """(port, `tcp` or `udp`) that the process listens on: with the robot's network, the robot's own"""
    ulimits: tuple[tuple[str, int, int], ...] = ()
    """(name, soft, hard)"""
    cap_add: tuple[str, ...] = ()
    cap_drop: tuple[str, ...] = ()
    privileged: bool = False
    sysctls: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    group_add: tuple[str, ...] = ()
    security_opt: tuple[str, ...] = ()
    device_cgroup_rules: tuple[str, ...] = ()
    tty: bool = False
    stdin_open: bool = False
    init: bool | None = None
    """An init process runs first. None: as the engine does by default."""
    read_only: bool = False
    """The container's root filesystem is."""
    hostname: str = ""
    """Empty: the service's name."""
    extra_hosts: tuple[tuple[str, str], ...] = ()
    """(name, address or `host-gateway`) of further lines of the hosts file"""
    labels: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    logging: Logging | None = None
    """None: the engine's default, with rotation where that is `json-file`."""
    mem_limit: int = 0
    """bytes; 0: no limit"""
    mem_reservation: int = 0
    """bytes that it is left with when memory is short"""
    oom_score_adj: int = 0
    """-1000 to 1000; the process with the highest is killed first when memory is short"""
    cpus: float = 0.0
    cpuset: str = ""
    """The processors that it may run on, such as `0-2,5`; empty: all."""
    pids_limit: int = 0
    shm_size: int = 0
    """bytes"""
    ipc: str = ""
    pid: str = ""
    gpus: str = ""
    """empty, `all`, or a count"""
    runtime: str = ""
    """What the engine runs containers with, such as `nvidia`; empty: its default."""
    restart: str = "no"
    """`no`, `always`, `unless-stopped`, `on-failure` or `on-failure:N`"""
    pull_policy: str = "missing"
    """`missing`, `always`, `never` or `build`"""
    job: bool = False


class BuildFile(msgspec.Struct, frozen=True, kw_only=True):
    """One file that a CDF copies into the image; `source` is an absolute path on the controller."""

    source: str
    dest: str
    mode: str = ""
    """Octal text such as `0755`, or empty for the file's own."""


class Repository(msgspec.Struct, frozen=True, kw_only=True):
    """One code repository whose files a CDF has in its image."""

    url: str
    """As `git_address` reads it."""
    ref: str
    """Branch, tag or commit; empty: the default branch. Of a commit that a lock has, `locked` is the branch or tag."""
    path: str
    """Absolute, inside the image; the shell commands of `run` run there."""
    run: tuple[str, ...] = ()
    locked: str | None = None


class ContainerDefinition(msgspec.Struct, frozen=True, kw_only=True):
    """One CDF after `extends` was merged. Exactly one of `base`, `image`, `dockerfile` is not empty."""

    name: str
    file: str
    """Absolute path of the CDF."""
    folder: str
    """Folder that relative paths start from."""
    text: str = ""
    """The CDF as it was read."""
    base: str = ""
    image: str = ""
    dockerfile: str = ""
    """Absolute path of a Dockerfile."""
    dockerfile_text: str = ""
    """The whole of it, as it was checked: it is what is built, whatever the file holds by then."""
    context: str = ""
    """Absolute path of the folder that it is built with; empty: its own."""
    build_args: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Values for its ARG instructions."""
    target: str = ""
    """The stage that is built; empty: the last."""
    images: tuple[str, ...] = ()
    """The images that it starts from or takes files of, as written; a variable in a name is not resolved."""
    pins: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Of these images, by the names that the Dockerfile has -> the name by digest that stands for it."""
    fetches: tuple[str, ...] = ()
    """What its Dockerfile ADDs from a URL, or may: such a source is fetched by the engine itself."""
    description: str = ""
    platforms: tuple[str, ...] = ()
    apt: tuple[str, ...] = ()
    pip: tuple[str, ...] = ()
    npm: tuple[str, ...] = ()
    repositories: tuple[Repository, ...] = ()
    files: tuple[BuildFile, ...] = ()
    run: tuple[str, ...] = ()
    build_environment: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """`environment` of the CDF: part of the image (ENV)."""
    runtime: Runtime = msgspec.field(default_factory=Runtime)
    """The CDF's own run-time defaults."""
    requires: Requirements = msgspec.field(default_factory=Requirements)
    location: Location = _NOWHERE
    lines: Mapping[str, int] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Line in the CDF of each build field (`base`, `packages.apt`, `run.0`, …): a failed build points there."""
