"""Names that a service adds to hosts files: its `hostname`, and `extra_hosts`; and what they may not stand for.

A service's own name is what others reach it by, so no other name of the experiment may be one. Who looks for a host
does not tell capitals apart, nor does this. What others find a service by is the EDF's word alone: with a name that a
CDF gives to itself, its service would take the place of any host that others speak with. Pure.
"""

from __future__ import annotations

import ipaddress
from collections.abc import Mapping

from srprov import names
from srprov.codes import Code
from srprov.definitions.model import Service
from srprov.yamldoc import nodes
from srprov.yamldoc.nodes import Findings, Map, Node, Path, Scalar

GATEWAY = "host-gateway"
"""Compose's word for the robot that the container runs on."""


def extra_hosts(node: Node | None, findings: Findings, path: Path) -> tuple[tuple[str, str], ...]:
    """Read the normal form of `extra_hosts` (`merging.normalise`) as (name, address) in name order."""
    found: list[tuple[str, str]] = []
    for name, value in sorted(node.entries.items()) if isinstance(node, Map) else ():
        for written in value.text.split() if isinstance(value, Scalar) else ():
            try:
                found.append((name, written if written == GATEWAY else str(ipaddress.ip_address(written.strip("[]")))))
            except ValueError:
                message = f"'{written[:60]}' is no address of '{name[:60]}'"
                findings.add(value, message, (*path, name), f"an IPv4 or IPv6 address, or {GATEWAY}", code=Code.OVERLAY)
    return tuple(dict.fromkeys(found))


def check(known: Mapping[str, Map], services: Mapping[str, Service], findings: Findings) -> None:
    """Add every name that means something else already; `known` has the services' entries in the EDF."""
    owners = {one.runtime.hostname.lower(): name for name, one in sorted(services.items(), reverse=True)}
    for name, one in services.items():
        path: Path = ("services", name)
        run = one.runtime
        place = nodes.key_or_value(known[name], "hostname")
        if run.hostname and (why := _not_as_hostname(one)):
            findings.add(place, why, (*path, "hostname"), code=Code.OVERLAY)
        elif run.hostname and "hostname" not in known[name].entries:
            message = "its CDF says a hostname, by which all other services would find it"
            hint = "say in the EDF which `hostname` this service has"
            findings.add(place, message, (*path, "hostname"), hint, code=Code.OVERLAY)
        elif run.hostname and (owner := owners[run.hostname.lower()]) != name:
            message = f"'{owner}' has the hostname '{run.hostname}' too"
            findings.add(place, message, (*path, "hostname"), code=Code.OVERLAY)
        elif run.hostname.lower() != name and (other := _meant(run.hostname, services)):
            findings.add(place, f"'{run.hostname}' is the name of {other}", (*path, "hostname"), code=Code.OVERLAY)
        place = nodes.key_or_value(known[name], "extra_hosts")
        for extra, address in run.extra_hosts:
            owner = owners.get(extra.lower(), "")
            if other := _meant(extra, services) or (f"the hostname of '{owner}'" if owner else ""):
                findings.add(place, f"'{extra}' is the name of {other}", (*path, "extra_hosts"), code=Code.OVERLAY)
            if address == GATEWAY and one.network == "none":
                message = f"'{extra}' would be the robot, which a service with 'network: none' cannot reach"
                findings.add(place, message, (*path, "extra_hosts"), code=Code.OVERLAY)


def _not_as_hostname(one: Service) -> str:
    if one.network in ("host", "both"):
        return f"a service with 'network: {one.network}' has the robot's hostname"
    if one.replicas != 1 or one.per_robot is not None:
        return "several instances of a service cannot have one hostname"
    return ""


def _meant(name: str, services: Mapping[str, Service]) -> str:
    """Return what a name stands for in every hosts file, in words, or nothing."""
    name = name.lower()
    if name in names.RESERVED:
        return "the container itself, or of its network"
    for at in (*(at for at, letter in enumerate(name) if letter == "-"), len(name)):
        one = services.get(name[:at])
        if one is not None and (at == len(name) or one.replicas != 1 or one.per_robot is not None):
            return f"the service '{name[:at]}'"
    return ""
