"""The lab's network: one bridge with the controller and every robot on it, and NAT to the world.

Changes links, firewall and forwarding of this machine, each under the lab's name, so that
`remove` finds them without a record. Forwarding is the one setting without a name: `ensure` gives
its value from before, for `remove`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from ipaddress import IPv4Network
from pathlib import Path

from srprov.errors import LabError
from srprov.lab import cable, partition
from srprov.lab.machine import run, succeeds, write_setting
from srprov.lab.places import (
    BRIDGE,
    CONTROLLER,
    REGISTRY_PORT,
    SUBNET,
    TAG,
    address,
    link,
)

FORWARDING = Path("/proc/sys/net/ipv4/ip_forward")

_OUT = ["-s", str(SUBNET), "!", "-d", str(SUBNET)]
_SYN = ["-p", "tcp", "--tcp-flags", "SYN,RST", "SYN"]
_NAME = ["-m", "comment", "--comment", TAG]

RULES: tuple[tuple[str, str, list[str]], ...] = (
    ("nat", "POSTROUTING", [*_OUT, *_NAME, "-j", "MASQUERADE"]),
    # Docker and firewalls set FORWARD to DROP; br_netfilter makes robots' frames meet it.
    ("filter", "FORWARD", ["-i", BRIDGE, *_NAME, "-j", "ACCEPT"]),
    ("filter", "FORWARD", ["-o", BRIDGE, *_NAME, "-j", "ACCEPT"]),
    (
        "filter",
        "INPUT",
        ["-i", BRIDGE, "-p", "tcp", "--dport", str(REGISTRY_PORT), *_NAME, "-j", "ACCEPT"],
    ),
    # The machine's way out may have a smaller MTU than the lab's 1500.
    ("mangle", "FORWARD", [*_OUT, *_SYN, *_NAME, "-j", "TCPMSS", "--clamp-mss-to-pmtu"]),
)


def ensure() -> dict[str, str]:
    """Make bridge, address, rules and forwarding; gives changed settings as they were before."""
    if not succeeds(["ip", "link", "show", BRIDGE]):
        _refuse_used_subnet()
        mac = _mac(1)
        run(["ip", "link", "add", BRIDGE, "address", mac, "type", "bridge", "forward_delay", "0"])
    run(["ip", "addr", "replace", f"{CONTROLLER}/{SUBNET.prefixlen}", "dev", BRIDGE])
    run(["ip", "link", "set", BRIDGE, "up"])
    for table, chain, rule in RULES:
        if not succeeds(["iptables", "-w", "-t", table, "-C", chain, *rule]):
            run(["iptables", "-w", "-t", table, "-I", chain, *rule])
    before = write_setting(FORWARDING, "1")
    return {} if before == "1" else {str(FORWARDING): before}


def remove(settings_before: Mapping[str, str]) -> None:
    """Nothing of `ensure` and `connect` is there afterwards, and no fault of a cable."""
    partition.heal_all()
    cable.repair()
    for table, chain, rule in RULES:
        while succeeds(["iptables", "-w", "-t", table, "-D", chain, *rule]):
            pass
    for name in [*_links(), BRIDGE]:
        succeeds(["ip", "link", "del", name])
    for path, value in settings_before.items():
        write_setting(Path(path), value)


def connect(inits: Mapping[str, int]) -> None:
    """Lay a cable from the bridge to eth0 of every robot; `inits` maps robot -> its PID 1."""
    for name in inits:
        disconnect(name)
    batch = []
    for name, pid in inits.items():
        ours, mac = link(name), _mac(int(address(name)) & 0xFF)
        batch.append(f"link add {ours} type veth peer name eth0 address {mac} netns {pid}")
        batch.append(f"link set {ours} master {BRIDGE} up")
    run(["ip", "-batch", "-"], stdin="\n".join(batch) + "\n")


def disconnect(name: str) -> None:
    """Pull the robot's cable; the kernel would do so a while after the robot's death."""
    if Path(f"/sys/class/net/{link(name)}").exists():
        succeeds(["ip", "link", "del", link(name)])


def _links() -> list[str]:
    return [path.name for path in Path("/sys/class/net").glob("srlab-r*")]


def _mac(last: int) -> str:
    """An address that stays the same over reboots, so that nobody's ARP cache goes stale."""
    return f"02:73:72:00:00:{last:02x}"


def _refuse_used_subnet() -> None:
    for route in json.loads(run(["ip", "-json", "-4", "route", "show"]) or "[]"):
        known = route["dst"]
        if known != "default" and IPv4Network(known).overlaps(SUBNET):
            what = f"the lab's subnet {SUBNET} is in use here: {known} on {route.get('dev', '?')}"
            raise LabError(what, hint="take that route away, or use another machine")
