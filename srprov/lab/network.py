"""A lab's network: a bridge with the controller and every robot on it, and NAT to the world.

A second bridge, where some robots are to be in another subnet, is a second LAN; the controller routes between them.

Changes links and firewall of this machine, each under the lab's name, so that `remove` finds them
without a record. What has no name, because all labs share it, is in sites.py.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping
from ipaddress import IPv4Network
from pathlib import Path

from srprov.codes import Code
from srprov.errors import LabError
from srprov.lab import cable, partition
from srprov.lab.machine import find, run, succeeds
from srprov.lab.places import LANS, REGISTRY_PORT, Site
from srprov.lab.spec import Robot

ANY_BRIDGE = "srlab+"
"""iptables' word for the bridges of all labs."""


Rule = tuple[str, str, str, list[str]]
"""Program, table, chain and words of a firewall rule."""


def rules(site: Site, lan: int = 1) -> list[Rule]:
    """Return the firewall rules of a LAN; each is inserted before those that stand here above it."""
    bridge, subnet = site.bridge_of(lan), str(site.subnet_of(lan))
    name = ["-m", "comment", "--comment", site.tag]
    out = ["-s", subnet, "!", "-d", subnet]
    syn = ["-p", "tcp", "--tcp-flags", "SYN,RST", "SYN"]
    mirror = ["-i", bridge, "-p", "tcp", "--dport", str(REGISTRY_PORT)]
    found = [
        ("nat", "POSTROUTING", [*out, *name, "-j", "MASQUERADE"]),
        # Docker and firewalls set FORWARD to DROP; br_netfilter makes robots' frames meet it.
        ("filter", "FORWARD", ["-i", bridge, *name, "-j", "ACCEPT"]),
        ("filter", "FORWARD", ["-o", bridge, *name, "-j", "ACCEPT"]),
        # Robots of two labs are strangers; frames within one bridge also meet this chain.
        ("filter", "FORWARD", ["-i", bridge, "-o", ANY_BRIDGE, *name, "-j", "DROP"]),
        ("filter", "FORWARD", ["-i", ANY_BRIDGE, "-o", bridge, *name, "-j", "DROP"]),
        ("filter", "FORWARD", ["-i", bridge, "-o", bridge, *name, "-j", "ACCEPT"]),
        ("filter", "INPUT", [*mirror, *name, "-j", "ACCEPT"]),
        # The machine's way out may have a smaller MTU than the lab's 1500.
        ("mangle", "FORWARD", [*out, *syn, *name, "-j", "TCPMSS", "--clamp-mss-to-pmtu"]),
    ]
    for other in LANS[: lan - 1]:  # they come first in all chains: a later LAN's rules are inserted later
        there, far = site.bridge_of(other), str(site.subnet_of(other))
        found += [("filter", "FORWARD", ["-i", i, "-o", o, *name, "-j", "ACCEPT"]) for i, o in _both(bridge, there)]
        found += [("nat", "POSTROUTING", ["-s", s, "-d", d, *name, "-j", "ACCEPT"]) for s, d in _both(subnet, far)]
    return [("iptables", *rule) for rule in found]


def rules6(site: Site, lan: int) -> list[Rule]:
    """Return the firewall rules of a LAN with IPv6, as frames of robots meet FORWARD there too; where it is at all."""
    bridge = site.bridge_of(lan)
    words = ["-i", bridge, "-o", bridge, "-m", "comment", "--comment", site.tag, "-j", "ACCEPT"]
    return [("ip6tables", "filter", "FORWARD", words)] if find("ip6tables") else []


def _both(one: str, other: str) -> Iterator[tuple[str, str]]:
    yield one, other
    yield other, one


def ensure(site: Site, robots: Collection[Robot]) -> None:
    """Make the bridges that these robots need, addresses and firewall rules."""
    for lan in LANS:
        ipv6 = any(robot.ipv6 for robot in robots if robot.lan == lan)
        if lan == 1 or any(robot.lan == lan for robot in robots):
            _ensure_lan(site, lan, ipv6=ipv6)


def _ensure_lan(site: Site, lan: int, *, ipv6: bool) -> None:
    bridge, subnet = site.bridge_of(lan), site.subnet_of(lan)
    if not succeeds(["ip", "link", "show", bridge]):
        _refuse_used_subnet(site, subnet)
        run(["ip", "link", "add", bridge, "address", site.mac(1, lan), "type", "bridge", "forward_delay", "0"])
    run(["ip", "addr", "replace", f"{subnet.network_address + 1}/{subnet.prefixlen}", "dev", bridge])
    run(["ip", "link", "set", bridge, "up"])
    if ipv6:
        run(["ip", "addr", "replace", f"{site.subnet6_of(lan).network_address + 1}/64", "dev", bridge, "nodad"])
    for program, table, chain, rule in [*rules(site, lan), *(rules6(site, lan) if ipv6 else ())]:
        if not succeeds([program, "-w", "-t", table, "-C", chain, *rule]):
            run([program, "-w", "-t", table, "-I", chain, *rule])


def remove(site: Site) -> None:
    """Nothing of `ensure` and `connect` is there afterwards, and no fault of a cable."""
    partition.heal_all(site)
    cable.repair(site)
    for program, table, chain, rule in [rule for lan in LANS for rule in (*rules(site, lan), *rules6(site, lan))]:
        while succeeds([program, "-w", "-t", table, "-D", chain, *rule]):
            pass
    for name in [*_links(site), *map(site.bridge_of, LANS)]:
        succeeds(["ip", "link", "del", name])


def connect(site: Site, inits: Mapping[Robot, int]) -> None:
    """Lay a cable from its bridge to eth0 of every robot; `inits` maps robot -> its PID 1."""
    for robot in inits:
        disconnect(site, robot.name)
    batch = []
    for robot, pid in inits.items():
        ours, mac = site.link(robot.name), site.mac(int(site.address(robot.name)) & 0xFF, robot.lan)
        mtu = f"mtu {robot.mtu}" if robot.mtu else ""
        batch.append(f"link add {ours} {mtu} type veth peer name eth0 address {mac} {mtu} netns {pid}")
        batch.append(f"link set {ours} master {site.bridge_of(robot.lan)} up")
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


def _refuse_used_subnet(site: Site, subnet: IPv4Network) -> None:
    user = in_use(subnet)
    if user is not None:
        free = "take a lab with a name, which gets a free subnet: srprov lab --name NAME up"
        hint = f"{site.command} down, then up: it gets another one" if site.name else free
        raise LabError(f"the lab's subnet {subnet} is in use here: {user}", hint=hint, code=Code.LAB_MACHINE)
