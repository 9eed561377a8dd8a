"""What is known of a robot: HostFacts. Values only; numbers are native (bytes, seconds, Mbit/s)."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import msgspec

from srprov.resource import Observed

MOST_SERIAL = 2**31 - 1
"""A placement record counts its changes. What it says is read again as it was written, or it is not known for ours."""


class Link(msgspec.Struct, frozen=True, kw_only=True):
    """One network interface."""

    name: str
    mtu: int = 1500
    up: bool = True
    mac: str = ""
    kind: str = ""
    """`vxlan`, `bridge`, `veth`… as iproute2 says, or empty for hardware."""
    addresses: tuple[str, ...] = ()
    """With prefix length, e.g. `10.0.0.5/24`."""
    speed_mbit: float = 0.0
    """0: unknown"""
    vni: int = 0
    """For a VXLAN; 0 otherwise."""
    port: int = 0
    alias: str = ""


_SMALLER = {"amd64": ("386",), "arm64": ("arm",)}
"""What a 64-bit system also runs."""


def native(arch: str) -> tuple[str, ...]:
    """Return the architectures that a processor of one runs, its own first; none where that is not known."""
    return (arch, *_SMALLER.get(arch, ())) if arch else ()


class Docker(msgspec.Struct, frozen=True, kw_only=True):
    """The robot's engine."""

    version: str
    api_version: str
    root: str = ""
    storage_driver: str = ""
    log_driver: str = ""
    """Of containers that ask for none; empty: not known."""
    rootless: bool = False


class HostFacts(msgspec.Struct, frozen=True, kw_only=True):
    """One robot as it is now."""

    name: str
    hostname: str = ""
    arch: str = ""
    """Docker's name of it: amd64, arm64, arm…"""
    emulates: tuple[str, ...] = ()
    """Other architectures whose programs its kernel hands to an emulator, in containers too; sorted."""
    cpus: int = 1
    load1: float = 0.0
    memory_total: int = 0
    memory_available: int = 0
    swap_total: int = 0
    swap_free: int = 0
    kernel: str = ""
    os: str = ""
    """PRETTY_NAME of os-release"""
    processor: str = ""
    """Its model, as the kernel names it; empty where it does not."""
    board: str = ""
    """What the machine is sold as."""
    machine_id: str = ""
    """Of this installation of its system; what it is made of is nobody else's business."""
    usb: tuple[str, ...] = ()
    """USB devices as `vendor:product name`, sorted, without hubs of the machine itself."""
    serials: tuple[str, ...] = ()
    """What tells this machine and its devices from others of their kind: `board SERIAL`, `vendor:product SERIAL`."""
    tags: tuple[str, ...] = ()
    """From the inventory and detected, sorted."""
    devices: tuple[str, ...] = ()
    """Paths below /dev that a service may ask for, sorted, with those of the inventory."""
    docker: Docker | None = None
    docker_problem: str = ""
    """Why there is no engine, in words, when `docker` is None."""
    wireguard: str = ""
    """What encrypts an overlay there: `kernel` or `userspace`; empty: nothing."""
    wireguard_problem: str = ""
    """Why nothing does, in words."""
    rules: str = ""
    """What keeps others out of an overlay there: `nftables` or `iptables`; `none`: nothing; empty: not known."""
    disk_total: int = 0
    """bytes of the filesystem with Docker's root"""
    disk_free: int = 0
    links: tuple[Link, ...] = ()
    routes: tuple[str, ...] = ()
    """Destinations of the main table, as CIDR."""
    relies_on: tuple[str, ...] = ()
    """IPv4 addresses of its SSH client, gateways, name servers and time servers, sorted."""
    underlay_link: str = ""
    underlay_address: str = ""
    """The address (no prefix) that other robots reach: the VTEP."""
    underlay_mtu: int = 1500
    speed_mbit: float = 0.0
    """Link speed of the underlay; 0: unknown"""
    traffic_mbit: float = 0.0
    """Traffic on it at the moment of asking; 0 when it was not sampled"""
    slots: int = 1
    clock_offset_s: float = 0.0
    systemd: bool = False
    """It is what the robot booted with, so that units of it are run."""
    user: str = ""
    """The user that reached it."""
    privileged: bool = True
    """False when commands do not run as root."""
    hosts: tuple[str, ...] = ()
    """Lines of its own /etc/hosts: an address and the names that it has."""
    hosts_cut: bool = False
    """There are more lines than are read."""
    homes: tuple[str, ...] = ()
    """`USER:FOLDER` of root and of the users that people are, sorted."""

    def home(self, user: str) -> str:
        """Return the home of a user; empty where it is not known."""
        return next((home for name, _, home in (one.partition(":") for one in self.homes) if name == user), "")

    @property
    def runs(self) -> tuple[str, ...]:
        """Architectures of which it runs images, its own first; empty where that is not known."""
        return tuple(dict.fromkeys((*self.native, *self.emulates))) if self.arch else ()

    @property
    def native(self) -> tuple[str, ...]:
        """Architectures that its processor runs, its own first; empty where that is not known."""
        return native(self.arch)


class TakenPort(msgspec.Struct, frozen=True, kw_only=True):
    """A port of a robot that something has, asked for only where an experiment wants ports."""

    address: str
    """Empty: all of the robot's."""
    port: int
    protocol: str
    """`tcp` or `udp`"""
    by: str
    """In words: a container, or the program that listens."""
    instance: str = ""
    """Of srprov, when it is a container of one."""


class Snapshot(msgspec.Struct, frozen=True, kw_only=True):
    """All robots as they are."""

    facts: Mapping[str, HostFacts]
    """Reachable robots by name."""
    observed: Mapping[str, tuple[Observed, ...]]
    """Per reachable robot, of every instance."""
    placements: Mapping[str, Mapping[str, Any]] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """instance -> the placement record that is believed (`controller/ownership.py`); empty as robots are asked."""
    records: Mapping[str, Mapping[str, Mapping[str, Any]]] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Robot -> instance -> the record that it holds."""
    proofs: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Robot -> what it proved to be (`Reader.identity`); only of those that answered."""
    unreachable: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Robot -> reason."""
    taken: Mapping[str, tuple[TakenPort, ...]] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Robot -> its ports that something has; only of robots that were asked."""
