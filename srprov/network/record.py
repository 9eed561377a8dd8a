"""The placement record: what every robot remembers of the whole instance, as /var/lib/srprov/INSTANCE/placement.json.

Takes an Overlay and where services run, gives JSON; and back. Pure. With it, what ran on a dead robot is known from any
other, and services keep their addresses for the instance's life. It holds no time; `serial` counts its
changes.

What comes back from a robot is untrusted: whatever is not of the right shape counts as not there.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from ipaddress import IPv4Address, ip_address
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import msgspec

from srprov import names
from srprov.definitions.model import Experiment
from srprov.facts.model import MOST_SERIAL
from srprov.untrusted import integer, mapping, string

if TYPE_CHECKING:
    from srprov.network.model import Overlay

_MAC = re.compile(r"[0-9a-f]{2}(:[0-9a-f]{2}){5}")


class PlacementRecord(msgspec.Struct, frozen=True, kw_only=True):
    """The last placement of an instance; maps hold only what the record says in the right shape."""

    robots: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Service -> robot."""
    addresses: Mapping[str, IPv4Address] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Service -> its address on the overlay."""
    macs: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    vteps: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Robot -> the underlay address that others reach."""
    gateways: Mapping[str, IPv4Address] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Robot -> its bridge's address."""
    vni: int = 0
    subnet: str = ""
    mtu: int = 0
    source: str = ""
    serial: int = 0


def record(
    overlay: Overlay,
    experiment: Experiment,
    placed: Mapping[str, str],
    source: str,
    before: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Return the record to write on every robot: JSON values only, keys sorted.

    Args:
        overlay: Where everything is on the network.
        experiment: For each service's network mode.
        placed: Service -> robot.
        source: Where the EDF comes from (git remote and path, else user@host:path).
        before: The record that is believed. `serial` is one more than its own when anything else differs,
            and 1 after the last one: a robot may have said that.
    """
    services = {
        name: {
            "ip": overlay.addresses.get(name, ""),
            "mac": overlay.macs.get(name, ""),
            "network": experiment.services[name].network,
            "robot": robot,
        }
        for name, robot in sorted(placed.items())
    }
    robots = {
        robot: {"gateway": overlay.gateways.get(robot, ""), "vtep": overlay.underlays.get(robot, "")}
        for robot in sorted(set(placed.values()))
    }
    content: dict[str, Any] = {
        "instance": overlay.instance,
        "mtu": overlay.mtu,
        "port": overlay.port,
        "robots": robots,
        "services": services,
        "source": source,
        "subnet": overlay.subnet,
        "vni": overlay.vni,
    }
    serial = _count((before or {}).get("serial"))
    same = before is not None and {k: v for k, v in before.items() if k != "serial"} == content
    following = serial + 1 if serial < MOST_SERIAL else 1
    return dict(sorted({**content, "serial": serial if same else following}.items()))


def read_record(value: Mapping[str, Any] | None) -> PlacementRecord | None:
    """Return what a record says; None when there is none."""
    if value is None:
        return None
    robots = _maps(value, "robots")
    services = {name: entry for name, entry in _maps(value, "services").items() if names.valid("service", name)}
    placed = {name: string(entry.get("robot")) for name, entry in services.items()}
    return PlacementRecord(
        robots={name: robot for name, robot in placed.items() if names.valid("robot", robot)},
        addresses={name: ip for name, entry in services.items() if (ip := _ipv4(entry.get("ip")))},
        macs={name: mac for name, entry in services.items() if _MAC.fullmatch(mac := string(entry.get("mac")))},
        vteps={name: vtep for name, entry in robots.items() if is_address(vtep := string(entry.get("vtep")))},
        gateways={name: ip for name, entry in robots.items() if (ip := _ipv4(entry.get("gateway")))},
        vni=_count(value.get("vni")),
        subnet=string(value.get("subnet")),
        mtu=_count(value.get("mtu")),
        source=string(value.get("source")),
        serial=_count(value.get("serial")),
    )


def _maps(value: Mapping[str, Any], key: str) -> dict[str, Mapping[str, Any]]:
    entries = mapping(value.get(key))
    return {string(name): entry for name, entry in sorted(entries.items()) if isinstance(entry, Mapping)}


def _count(value: object) -> int:
    return integer(value) if isinstance(value, int) else 0


def _ipv4(value: object) -> IPv4Address | None:
    try:
        return IPv4Address(string(value))
    except ValueError:
        return None


def is_address(text: str) -> bool:
    """Return whether a text is a plain address; ipaddress takes any text behind a %, lines too, as its scope."""
    if "%" in text:
        return False
    try:
        ip_address(text)
    except ValueError:
        return False
    return True
