"""One instance's network, as a value."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import msgspec


class Tunnel(msgspec.Struct, frozen=True, kw_only=True):
    """What is between the members of an encrypted overlay."""

    netns: str
    interface: str
    """Of the two, the one that carries the overlay."""
    port: int
    """UDP, of that interface, on every robot."""
    mtu: int
    endpoints: Mapping[str, str]
    """Member robot -> its underlay address, a colon, and the port."""


class Overlay(msgspec.Struct, frozen=True, kw_only=True):
    """One instance's network. With no service on the overlay, only the first three fields say anything."""

    instance: str
    names: Mapping[str, str]
    """Service -> the address its name resolves to, on every robot; not in it: services without network."""
    aliases: Mapping[str, tuple[str, ...]] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Name in the EDF of what runs several times -> the addresses of all its instances, in their order."""
    underlays: Mapping[str, str]
    """Robot that runs anything -> its underlay address, as far as known."""
    vni: int = 0
    port: int = 0
    bridge: str = ""
    link: str = ""
    network: str = ""
    """The Docker network's name."""
    subnet: str = ""
    mtu: int = 0
    """bytes, of the bridge, the VXLAN link and what is inside containers"""
    addresses: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Service on the overlay -> its address there."""
    macs: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Service with an interface of its own -> its MAC; `both` has none, its address is on the robot's bridge."""
    bridge_macs: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Member robot -> the MAC that its bridge is given, which others have entries for."""
    gateways: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Member robot -> its bridge's address."""
    vteps: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Member robot -> its underlay address."""
    flood: Mapping[str, tuple[str, ...]] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Member robot -> the VTEPs of all other members, inside of a tunnel: its all-zero forwarding entries."""
    fdb: Mapping[str, tuple[tuple[str, str], ...]] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Member robot -> (MAC, VTEP, inside of a tunnel) of every service on another member, and of every other
    robot's bridge."""
    tunnel: Tunnel | None = None
    """What encrypts it, if anything does. Then packets come from and go to the robots' `gateways`, inside of it."""

    @property
    def active(self) -> bool:
        """True when some service is on the overlay, so that there is a network to make."""
        return bool(self.vteps)
