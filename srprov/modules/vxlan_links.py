"""What a robot says of its VXLAN links, their bridges and their forwarding entries. Pure; that is untrusted.

Source: iproute2's `ip -j -d addr show` and `bridge -j fdb show`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from srprov.modules import bridge_address
from srprov.robot_answers import TooManyError
from srprov.untrusted import integer, mappings, string
from srprov.wire import Reply

ENTRIES = """printf '['
for link in $(ip -o link show type vxlan | cut -d : -f 2 | cut -d @ -f 1); do
  case $link in *[!a-z0-9]*) continue ;; srpv*) ;; *) continue ;; esac
  printf '{"ifname":"%s","entries":' "$link"
  bridge -j fdb show dev "$link" || echo null
  printf '},'
done
echo '{}]'"""
"""Of each link by itself, which learns nothing: what bridges learn of containers' ports has no end, as a container may
send from any MAC."""


def listed(reply: Reply) -> list[Mapping[str, Any]]:
    """Return what a program lists; nothing where there is no such program.

    Raises:
        TooManyError: It lists what cannot be read: links that are there would pass for gone.
    """
    items = reply.json() if reply.ok else []
    if not isinstance(items, list):
        raise TooManyError("what it lists of its links and their forwarding entries cannot be read")
    return mappings(items)


def kind_of(item: Mapping[str, Any]) -> str:
    """Return what kind of link it is, such as `vxlan`."""
    info = item.get("linkinfo")
    return string(info.get("info_kind")) if isinstance(info, Mapping) else ""


def _data(item: Mapping[str, Any], of: str = "info_data") -> Mapping[str, Any]:
    info = item.get("linkinfo")
    data = info.get(of) if isinstance(info, Mapping) else None
    return data if isinstance(data, Mapping) else {}


def bridge_state(name: str, bridge: Mapping[str, Any]) -> dict[str, Any]:
    """Return what is said of the bridge that a link is a port of."""
    return {"snooping": bool(_data(bridge).get("mcast_snooping", 1)), **bridge_address.found(name, bridge)}


def link_state(item: Mapping[str, Any], mine: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return what is said of a link, and by its own forwarding entries."""
    data = _data(item)
    flags = item.get("flags")
    bridge = string(item.get("master"))
    fdb = sorted([string(entry.get("mac")), string(entry.get("dst"))] for entry in mine if entry.get("dst"))
    fixed = [one for one in mine if bridge and one.get("master") == bridge and one.get("state") == "static"]
    ports = data.get("port_range")
    return {
        "vni": integer(data.get("id")),
        "local": string(data.get("local") or data.get("local6")),
        "port": integer(data.get("port")),
        "learning": bool(data.get("learning", False)),
        "source_ports": [integer(ports.get("low")), integer(ports.get("high"))] if isinstance(ports, Mapping) else [],
        "port_learning": bool(_data(item, "info_slave_data").get("learning", False)),
        "elsewhere": "link_netnsid" in item or "link_netns" in item,
        "bridge": bridge,
        "mtu": integer(item.get("mtu")),
        "up": "UP" in flags if isinstance(flags, list) else False,
        "fdb": fdb,
        "bridge_fdb": sorted(string(entry.get("mac")) for entry in fixed),
    }
