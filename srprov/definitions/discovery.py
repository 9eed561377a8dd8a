"""`network.discovery` of an EDF: which of its kinds need services that the others ask, and which those may be. Pure."""

from __future__ import annotations

from collections.abc import Mapping

from srprov.codes import Code
from srprov.definitions.model import Service
from srprov.definitions.values import scalars, text
from srprov.yamldoc import nodes
from srprov.yamldoc.nodes import Findings, Map, Path

_SERVERS = {
    "ros1": "the service that runs the ROS master",
    "discovery-server": "the services that run Fast DDS Discovery Servers",
    "zenoh": "the services that run Zenoh routers",
}
"""Discovery with servers -> what its `discovery_servers` are."""


def check(root: Map, services: Mapping[str, Service], findings: Findings) -> None:
    """Add servers that are missing, too many, needless, or that nobody could ask."""
    network = root.entries.get("network")
    if not isinstance(network, Map) or findings.broken(("network",)):
        return
    get = network.entries.get
    named, kind = list(scalars(get("discovery_servers"))), text(get("discovery")) or "multicast"
    path: Path = ("network", "discovery_servers")
    if kind not in _SERVERS:
        if "discovery_servers" in network.entries:
            findings.add(
                network.keys["discovery_servers"],
                f"'discovery: {kind}' has no servers",
                path,
                f"only {', '.join(_SERVERS)} have them",
                code=Code.OVERLAY,
            )
        return
    if not named:
        hint = f"name {_SERVERS[kind]}"
        place = nodes.key_or_value(network, "discovery")
        findings.add(place, f"'discovery: {kind}' needs 'discovery_servers'", path, hint, code=Code.OVERLAY)
    for item in named:
        one = services.get(item.text)
        if one is not None and one.network == "none":
            findings.add(item, f"nobody reaches '{item.text}', which has 'network: none'", path, code=Code.OVERLAY)
        elif kind == "ros1" and one is not None and (one.replicas != 1 or one.per_robot is not None):
            findings.add(item, f"several instances of '{item.text}' cannot be one ROS master", path, code=Code.OVERLAY)
    if kind == "ros1" and named[1:]:
        findings.add(named[1], "there is one ROS master, not several", path, code=Code.OVERLAY)
