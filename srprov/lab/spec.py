"""lab-spec.yml -> LabSpec: which robots the lab has, and what each of them simulates.

Pure: takes the file's text, gives values, or a `DefinitionError` with every problem and its
place. One table, `OPTIONS`, says which options a robot has: a further option is one reader, one
field of `Robot` and whoever acts on it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

import msgspec
from msgspec.structs import replace

from srprov.errors import DefinitionError
from srprov.lab.figures import Amount
from srprov.lab.greeting import FORMS, strange_line
from srprov.lab.places import LANS, MOST_ROBOTS, robot_name, robot_number
from srprov.yamldoc.fields import FieldReader
from srprov.yamldoc.nodes import Map, Node, is_null

DEFAULT_COUNT = 4
USERS = ("root", "robot")
ARCHITECTURES = ("arm64",)
LEAST_MTU, MOST_MTU = 1280, 9000
"""bytes; less is no IPv6, and no network card does much more"""
LEAST_CPUS = 0.05
"""With less, a robot does not come up in time."""
SSHD_LIMITS = ("max_startups", "max_sessions")


class Sshd(msgspec.Struct, frozen=True):
    """Limits of a robot's sshd; None: so high that no provisioner meets them."""

    max_startups: int | None = None
    max_sessions: int | None = None


class Latency(msgspec.Struct, frozen=True):
    """How late SSH is, in milliseconds."""

    to_ms: float
    """To the robot."""
    from_ms: float

    @property
    def rtt_ms(self) -> float:
        """Of a round trip."""
        return self.to_ms + self.from_ms


class Robot(msgspec.Struct, frozen=True):
    """One robot of the lab and its options; None where the machine's own figure shows."""

    name: str
    tags: tuple[str, ...] = ()
    devices: tuple[str, ...] = ()
    slots: int | None = None
    load: float | None = None
    cpus: float | None = None
    memory: Amount | None = None
    swap: Amount | None = None
    docker: bool = True
    arch: str | None = None
    user: str | None = None
    lan: int = 1
    ipv6: bool = False
    mtu: int | None = None
    systemd: bool = False
    ssh_latency_ms: Latency | None = None
    rate_mbit: float | None = None
    loss_percent: float | None = None
    disk_mib: int | None = None
    docker_read_only: bool = False
    clock_offset_s: float | None = None
    sshd: Sshd | None = None
    bashrc: str | None = None
    sudo_password: str | None = None
    unprivileged: bool = False

    @property
    def boot_digest(self) -> str:
        """Equal for options that boot the same robot; the others only go to the inventory."""
        kept = msgspec.to_builtins(replace(self, tags=(), slots=None, user=None))
        return json.dumps(kept, sort_keys=True)


class LabSpec(msgspec.Struct, frozen=True):
    """A lab: how many robots, and the options of those that have any."""

    count: int | None = None
    defaults: Mapping[str, Any] = msgspec.field(default_factory=dict)
    robots: Mapping[str, Mapping[str, Any]] = msgspec.field(default_factory=dict)

    @property
    def least(self) -> int:
        """The count that has room for every robot with options."""
        return max((robot_number(name) or 0 for name in self.robots), default=0)

    def build(self, count: int) -> list[Robot]:
        """The robots robot1 .. robot<count>."""
        names = [robot_name(number) for number in range(1, count + 1)]
        return [Robot(name, **{**self.defaults, **self.robots.get(name, {})}) for name in names]


def parse(text: str, file: str) -> LabSpec:
    """Read a lab-spec.yml; `file` is its name in messages."""
    reader = FieldReader(text, file)
    spec = LabSpec()
    for key, node in reader.mapping(reader.root, ("count", "defaults", "robots")):
        if key.text == "count":
            count = reader.integer(node, 1, MOST_ROBOTS)
            spec = replace(spec, count=count)
        elif key.text == "defaults":
            spec = replace(spec, defaults=_options(reader, node))
        else:
            spec = replace(spec, robots=_robots(reader, node))
    if spec.count is not None and spec.least > spec.count:
        reader.problem(reader.root, f"robot{spec.least} has options, but count is {spec.count}")
    if reader.findings.problems:
        raise DefinitionError(reader.findings.problems)
    return spec


def _robots(reader: FieldReader, node: Node) -> dict[str, dict[str, Any]]:
    found = {}
    for key, value in reader.mapping(node):
        if robot_number(key.text) is None:
            reader.problem(key, f"{key.text!r} is not robot1 .. robot{MOST_ROBOTS}")
            continue
        found[key.text] = {} if is_null(value) else _options(reader, value)
    return found


def _options(reader: FieldReader, node: Node) -> dict[str, Any]:
    options = {}
    for key, value in reader.mapping(node, tuple(OPTIONS)):
        read = OPTIONS[key.text](reader, value)
        if read is not None:
            options[key.text] = read
    return options


def _tags(reader: FieldReader, node: Node) -> tuple[str, ...]:
    return tuple(reader.string(item) for item in reader.sequence(node))


def _devices(reader: FieldReader, node: Node) -> tuple[str, ...]:
    paths = []
    for item in reader.sequence(node):
        path = reader.string(item)
        plain = path.replace("/", "").replace("-", "").replace("_", "").replace(".", "")
        parts = path.split("/")[2:]
        if not path.startswith("/dev/") or not plain.isalnum() or {"", ".", ".."} & set(parts):
            reader.problem(item, f"{path!r} is not a device such as /dev/video0")
        elif path in paths or path in BUILT_IN or parts[0] in ("pts", "shm", "mqueue", "fd"):
            reader.problem(item, f"{path} is there already")
        else:
            paths.append(path)
    return tuple(paths)


def _amount(reader: FieldReader, node: Node) -> Amount | None:
    """`4G`, or `{total: 4G, used: 1G}`."""
    if not isinstance(node, Map):
        total = reader.size(node)
        return None if total is None else Amount(total)
    sizes = {k.text: reader.size(value) for k, value in reader.mapping(node, ("total", "used"))}
    total, used = sizes.get("total"), sizes.get("used", 0)
    if total is None or used is None:
        if "total" not in sizes:
            reader.problem(node, "total is missing")
        return None
    if used > total:
        reader.problem(node, "used is more than total")
    return Amount(total, used)


def _slots(reader: FieldReader, node: Node) -> int | None:
    return reader.integer(node, 0, 1000)


def _user(reader: FieldReader, node: Node) -> str | None:
    return reader.choice(node, USERS)


def _bashrc(reader: FieldReader, node: Node) -> str:
    text = reader.string(node)
    if text and (line := strange_line(text)):
        why = f"{line.strip()[:60]!r} is no line that a login may have: {FORMS}"
        reader.problem(node, why, "write anything else on the robot itself: srprov lab shell ROBOT")
    return text


def _sshd(reader: FieldReader, node: Node) -> Sshd:
    found = {key.text: reader.integer(value, 1, 1000) for key, value in reader.mapping(node, SSHD_LIMITS)}
    return Sshd(**found)


def _latency(reader: FieldReader, node: Node) -> Latency | None:
    """`80`, half of it each way, or `{to: 60, from: 20}`; None where it is not late at all."""
    if isinstance(node, Map):
        ways = {key.text: reader.number(value, 0, 5000) for key, value in reader.mapping(node, ("to", "from"))}
        found = Latency(ways.get("to") or 0.0, ways.get("from") or 0.0)
    else:
        half = (reader.number(node, 0, 10_000) or 0.0) / 2
        found = Latency(half, half)
    return found if found.rtt_ms else None


def _number(least: float, most: float) -> Callable[[FieldReader, Node], float | None]:
    return lambda reader, node: reader.number(node, least, most)


OPTIONS: Mapping[str, Callable[[FieldReader, Node], Any]] = {
    "tags": _tags,
    "devices": _devices,
    "slots": _slots,
    "load": _number(0, 1000),
    "cpus": _number(LEAST_CPUS, 1000),
    "memory": _amount,
    "swap": _amount,
    "docker": FieldReader.boolean,
    "arch": lambda reader, node: reader.choice(node, ARCHITECTURES),
    "user": _user,
    "lan": lambda reader, node: reader.integer(node, min(LANS), max(LANS)),
    "ipv6": FieldReader.boolean,
    "mtu": lambda reader, node: reader.integer(node, LEAST_MTU, MOST_MTU),
    "systemd": FieldReader.boolean,
    "ssh_latency_ms": _latency,
    "rate_mbit": _number(0.1, 10_000),
    "loss_percent": _number(0, 100),
    "disk_mib": lambda reader, node: reader.integer(node, 32, 1_000_000),
    "docker_read_only": FieldReader.boolean,
    "clock_offset_s": _number(-100_000_000, 100_000_000),
    "sshd": _sshd,
    "bashrc": _bashrc,
    "sudo_password": FieldReader.string,
    "unprivileged": FieldReader.boolean,
}

BUILT_IN = {
    f"/dev/{name}"
    for name in (
        *("null", "zero", "full", "random", "urandom", "kmsg", "tty", "net", "net/tun", "fuse"),
        *("pts", "shm", "mqueue", "ptmx", "fd", "stdin", "stdout", "stderr"),
    )
}
