"""Who is probed, and what was measured between two. Values only."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import msgspec

GATEWAY, SERVICE, UNDERLAY = "gateway", "service", "underlay"


class Endpoint(msgspec.Struct, frozen=True, kw_only=True):
    """An address that asks, and is asked."""

    kind: str
    """`gateway`: the robot's own on the overlay; `service`: a service's there; `underlay`: the robot's VTEP."""
    robot: str
    address: str
    service: str = ""
    container: str = ""
    """Whose network namespace it is in; empty: the robot's own."""
    mac: str = ""
    """What the overlay gave it; empty: not known."""
    sparse: bool = False
    """Probed with robots and one service of each robot only."""

    @property
    def name(self) -> str:
        """Return what it is called in tables: the robot, or `SERVICE@ROBOT`."""
        return f"{self.service}@{self.robot}" if self.service else self.robot


class Request(msgspec.Struct, frozen=True, kw_only=True):
    """What of an instance is probed."""

    instance: str
    bridge: str
    link: str
    mtu: int
    """bytes, of the overlay"""
    underlay_mtu: int
    """bytes that the underlay must carry for that"""
    vni: int
    port: int
    tunnel_port: int = 0
    """UDP, of WireGuard, which then carries the overlay; 0: it is not encrypted."""
    endpoints: tuple[Endpoint, ...]

    @property
    def robots(self) -> tuple[str, ...]:
        """Return the members of the overlay, sorted."""
        return tuple(sorted({one.robot for one in self.endpoints}))

    def of(self, robot: str) -> dict[int, Endpoint]:
        """Return a robot's endpoints by their index."""
        return {at: one for at, one in enumerate(self.endpoints) if one.robot == robot}


class Measured(msgspec.Struct, frozen=True, kw_only=True):
    """What one endpoint says of another."""

    sent: int = 0
    received: int = 0
    rtt_us: tuple[int, int, int] = (0, 0, 0)
    """least, mean, most"""
    heard: bool = False
    """Packets of the other came here."""
    fits: int = 0
    """bytes of the largest packet that must not be fragmented and came back"""
    path_mtu: int = 0
    """What a machine on the way said is the most; 0: none did."""
    multicast: bool = False
    """A datagram that the other sent to a group came here."""
    tcp: bool = False
    tcp_error: int = 0
    """errno"""
    error: int = 0
    """errno of the last packet that could not be sent"""
    unreachable: int = 0
    """1 and the code of an ICMP message that says so; 0: none came"""
    source: str = ""
    """Where packets of the other came from, if not from its address."""


class Said(msgspec.Struct, frozen=True, kw_only=True):
    """What one endpoint says."""

    failed: str = ""
    """What it could not open: `namespace`, `address`, `listen`, `multicast`; empty: it asked."""
    error: int = 0
    peers: Mapping[int, Measured] = msgspec.field(default_factory=lambda: MappingProxyType({}))


class Round(msgspec.Struct, frozen=True, kw_only=True):
    """One round of asking: everybody at once."""

    request: Request
    """With those alone that were there to be asked."""
    said: Mapping[int, Said]
    """Endpoint's index -> what it says; not in it: nothing was heard of it."""
    left_out: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Service or robot -> why it was not asked."""
    lost: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Robot -> why it could not be asked, or ended without an answer."""
    namespaces: Mapping[int, int] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Endpoint's index -> process whose network namespace it is in; not in it: the robot's own."""
