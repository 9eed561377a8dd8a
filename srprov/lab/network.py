"""A lab's network: one bridge with the controller and every robot on it, and NAT to the world.

Changes links and firewall of this machine, each under the lab's name, so that `remove` finds them
without a record. What has no name, because all labs share it, is in sites.py.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from ipaddress import IPv4Network
from pathlib import Path

from srprov.errors import LabError
from srprov.lab import cable, partition
from srprov.lab.machine import run, succeeds
from srprov.lab.places import REGISTRY_PORT, Site

ANY_BRIDGE = "srlab+"
"""iptables' word for the bridges of all labs."""


def rules(site: Site) -> list[tuple[str, str, list[str]]]:
    """Return table, chain and words of each firewall rule; each is inserted before those that stand here above it."""
    name = ["-m", "comment", "--comment", site.tag]
    out = ["-s", str(site.subnet), "!", "-d", str(site.subnet)]
    syn = ["-p", "tcp", "--tcp-flags", "SYN,RST", "SYN"]
    mirror = ["-i", site.bridge, "-p", "tcp", "--dport", str(REGISTRY_PORT)]
    return [
        ("nat", "POSTROUTING", [*out, *name, "-j", "MASQUERADE"]),
        # Docker and firewalls set FORWARD to DROP; br_netfilter makes robots' frames meet it.
        ("filter", "FORWARD", ["-i", site.bridge, *name, "-j", "ACCEPT"]),
        ("filter", "FORWARD", ["-o", site.bridge, *name, "-j", "ACCEPT"]),
        # Robots of two labs are strangers; frames within one bridge also meet this chain.
        ("filter", "FORWARD", ["-i", site.bridge, "-o", ANY_BRIDGE, *name, "-j", "DROP"]),
        ("filter", "FORWARD", ["-i", ANY_BRIDGE, "-o", site.bridge, *name, "-j", "DROP"]),
        ("filter", "FORWARD", ["-i", site.bridge, "-o", site.bridge, *name, "-j", "ACCEPT"]),
        ("filter", "INPUT", [*mirror, *name, "-j", "ACCEPT"]),
        # The machine's way out may have a smaller MTU than the lab's 1500.
        ("mangle", "FORWARD", [*out, *syn, *name, "-j", "TCPMSS", "--clamp-mss-to-pmtu"]),
    ]


def ensure(site: Site) -> None:
    """Make bridge, address and firewall rules."""
    if not succeeds(["ip", "link", "show", site.bridge]):
        _refuse_used_subnet(site)
        run(["ip", "link", "add", site.bridge, "address", site.mac(1), "type", "bridge", "forward_delay", "0"])
    run(["ip", "addr", "replace", f"{site.controller}/{site.subnet.prefixlen}", "dev", site.bridge])
    run(["ip", "link", "set", site.bridge, "up"])
    for table, chain, rule in rules(site):
        if not succeeds(["iptables", "-w", "-t", table, "-C", chain, *rule]):
            run(["iptables", "-w", "-t", table, "-I", chain, *rule])


def remove(site: Site) -> None:
    """Nothing of `ensure` and `connect` is there afterwards, and no fault of a cable."""
    partition.heal_all(site)
    cable.repair(site)
    for table, chain, rule in rules(site):
        while succeeds(["iptables", "-w", "-t", table, "-D", chain, *rule]):
            pass
    for name in [*_links(site), site.bridge]:
        succeeds(["ip", "link", "del", name])


def connect(site: Site, inits: Mapping[str, int]) -> None:
    """Lay a cable from the bridge to eth0 of every robot; `inits` maps robot -> its PID 1."""
    for name in inits:
        disconnect(site, name)
    batch = []
    for name, pid in inits.items():
        ours, mac = site.link(name), site.mac(int(site.address(name)) & 0xFF)
        batch.append(f"link add {ours} type veth peer name eth0 address {mac} netns {pid}")
        batch.append(f"link set {ours} master {site.bridge} up")
    run(["ip", "-batch", "-"], stdin="\n".join(batch) + "\n")


def disconnect(site: Site, name: str) -> None:
    """Pull the robot's cable; the kernel would do so a while after the robot's death."""
    if Path(f"/sys/class/net/{site.link(name)}").exists():
        succeeds(["ip", "link", "del", site.link(name)])


def _links(site: Site) -> list[str]:
    return [path.name for path in Path("/sys/class/net").glob(f"{site.link_prefix}*")]


def in_use(subnet: IPv4Network) -> str | None:
    """Return who has a part of the subnet on this machine, as `route on device`; None if it is free."""
    for route in json.loads(run(["ip", "-json", "-4", "route", "show"]) or "[]"):
        known = route["dst"]
        if known != "default" and IPv4Network(known).overlaps(subnet):
            return f"{known} on {route.get('dev', '?')}"
    return None


def _refuse_used_subnet(site: Site) -> None:
    user = in_use(site.subnet)
    if user is not None:
        free = "take a lab with a name, which gets a free subnet: srprov lab --name NAME up"
        hint = f"{site.command} down, then up: it gets another one" if site.name else free
        raise LabError(f"the lab's subnet {site.subnet} is in use here: {user}", hint=hint)
