"""Addresses of services on their robot's bridge: part of what the module of kind `vxlan` keeps right. Pure.

A service with `network: both` is on the robot's own network, so that its address on the overlay is one of the robot's:
it stands on the instance's bridge, with a label that tells it from Docker's own. The bridge gets a fixed MAC, for which
the other robots have a forwarding entry: what a robot itself says on the overlay would go to all of them otherwise.

Source: Linux `ip-sysctl`, arp_notify: when the MAC of a link is set, all of its addresses are announced. So whoever
remembers where an address was before learns at once where it is now. ip-address(8) on labels.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

from srprov.modules.params import ParameterError, check_ipv4, check_mac
from srprov.resource import State
from srprov.untrusted import mappings, string
from srprov.wire import quote

_LABEL = ":s"
"""Behind the bridge's name, which a label must begin with; a label has 15 characters at most."""


def check(mac: str, addresses: Collection[str]) -> None:
    """Refuse what is no MAC of one interface, and what is no IPv4 address.

    Raises:
        ParameterError: Names the parameter.
    """
    if mac:
        check_mac(mac, "bridge_mac")
    if mac and int(mac[:2], 16) & 1:
        raise ParameterError("bridge_mac", f"bridge_mac: '{mac}' is no MAC of an interface")
    if addresses and not mac:
        raise ParameterError("bridge_mac", "bridge_mac: addresses need one, to be announced with")
    for address in addresses:
        check_ipv4(address, "addresses")


def found(bridge: str, item: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a robot says of its bridge's MAC and of the services' addresses there."""
    infos = [one for one in mappings(item.get("addr_info")) if one.get("label") == bridge + _LABEL]
    addresses = sorted(string(one.get("local")) for one in infos if one.get("family") == "inet")
    return {"bridge_mac": string(item.get("address")), "addresses": addresses}


def differences(mac: str, addresses: Collection[str], state: State) -> list[str]:
    """Return in words what is not as it should be."""
    causes = []
    if mac and state["bridge_mac"] != mac:
        causes.append(f"the bridge's MAC is {state['bridge_mac'] or 'not known'}, not {mac}")
    wanted, there = set(addresses), set(state["addresses"])
    if wanted != there:
        add, remove = len(wanted - there), len(there - wanted)
        causes.append(f"addresses of services: {add} to add, {remove} to remove")
    return causes


def announcing(bridge: str, mac: str) -> list[str]:
    """Return the shell line that has the kernel announce the bridge's addresses when its MAC is set."""
    return [f"echo 1 >{quote(f'/proc/sys/net/ipv4/conf/{bridge}/arp_notify')} || exit"] if mac else []


def calls(bridge: str, mac: str, wanted: Sequence[str], there: Sequence[str] | None) -> list[list[str]]:
    """Return calls of ip(8). The MAC is set last, also to what it is: that announces the addresses.

    `there` are the services' addresses on the bridge; None: not known.
    """
    if there is None:
        made = [["addr", "flush", "dev", bridge, "label", bridge + _LABEL]] if wanted else []
    else:
        made = [["addr", "del", f"{one}/32", "dev", bridge] for one in sorted(set(there) - set(wanted))]
    made += [["addr", "replace", f"{one}/32", "dev", bridge, "label", bridge + _LABEL] for one in sorted(set(wanted))]
    return [*made, ["link", "set", "dev", bridge, "address", mac]] if mac else made
