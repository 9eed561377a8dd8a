"""Robots that a reboot cut off: their containers run, and the link to the other robots is not there.

Docker makes its bridges anew when a robot boots, and starts containers that are to be started always; the VXLAN link
is gone. A link that somebody deleted leaves a bridge as srprov had set it: with multicast snooping off. So what tells
of a reboot is a bridge of ours as Docker makes it, with containers on it and without a link. Pure.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from srprov.resource import Observed
from srprov.untrusted import mapping, string

ISOLATED = "isolated"
"""In the state of a link that is not there."""
_BRIDGE, _LINK = "srpb", "srpv"


def isolated(every: Sequence[Mapping[str, Any]], bridges: Mapping[str, Mapping[str, Any]]) -> Iterator[Observed]:
    """Yield the links that robots have lost by a reboot; nobody owns one, as there is nothing to remove.

    Args:
        every: What `ip -j -d addr show` says of all interfaces.
        bridges: The bridges among them by name.
    """
    names = {string(item.get("ifname")) for item in every}
    used = {string(item.get("master")) for item in every}
    for name, bridge in bridges.items():
        link = _LINK + name.removeprefix(_BRIDGE)
        snoops = mapping(mapping(bridge.get("linkinfo")).get("info_data")).get("mcast_snooping") == 1
        if name.startswith(_BRIDGE) and name in used and link not in names and snoops:
            yield Observed(module="vxlan", name=link, instance="", state={ISOLATED: True, "addresses": []})
