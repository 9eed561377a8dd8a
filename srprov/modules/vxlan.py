"""VXLAN links: the port of a robot's bridge to all other robots of the instance.

Learning is off, of the link and of the bridge behind it: the controller knows every entry. A bridge that had learned
a service on the link would send nothing to it once it has moved to that very robot, until it says something by itself.
The link's alias carries the instance, and the bridge's multicast snooping is off, since no querier is there that would
keep groups alive.

Source: Linux `vxlan` documentation, iproute2's ip-link(8) and bridge(8).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

import msgspec

from srprov.modules import bridge_address
from srprov.modules.ip_batch import batch
from srprov.modules.isolated import ISOLATED, isolated
from srprov.modules.module import Module, Names
from srprov.modules.params import check_mac
from srprov.modules.vxlan_fdb import entries_of, fdb_calls, known
from srprov.modules.vxlan_links import ENTRIES, bridge_state, kind_of, link_state, listed
from srprov.modules.vxlan_rules import SOURCE_PORTS, closed_first, rules_hash
from srprov.resource import Action, Change, Observed, State
from srprov.untrusted import mappings, string
from srprov.wire import AnyQuery, Command, Query, Reply, Run, quote

_ALIAS = "srprov:"
_PREFIX = "srpv"


class VxlanParams(msgspec.Struct, frozen=True, kw_only=True):
    """What a playbook says of a VXLAN link."""

    instance: str
    vni: int
    local: str
    """The VTEP's address."""
    port: int
    bridge: str
    mtu: int
    netns: str = ""
    """The network namespace that its packets go through, where they are encrypted; empty: the robot's own."""
    fdb: tuple[tuple[str, str], ...]
    """Pairs of MAC and VTEP; the all-zero MAC stands for head-end replication of broadcast and multicast."""
    bridge_mac: str = ""
    """What the bridge's MAC must be, as other robots have an entry for it; empty: as it is."""
    addresses: tuple[str, ...] = ()
    """Addresses of the bridge beside its network's: those of services that are on the robot's own network too."""

    @property
    def vteps(self) -> tuple[str, ...]:
        """Robots' addresses that its packets come from and go to; in a namespace of its own it has others."""
        return () if self.netns else (self.local, *(vtep for _, vtep in self.fdb))

    def __post_init__(self) -> None:
        """Refuse what is no address: it goes into commands as it stands."""
        bridge_address.check(self.bridge_mac, self.addresses)
        for mac, _ in self.fdb:
            check_mac(mac, "fdb")


class VxlanModule(Module[VxlanParams]):
    """The module of kind `vxlan`."""

    kind = "vxlan"
    params = VxlanParams
    common = True
    on_overlay = True
    shares_round_trip = True

    def queries(self) -> tuple[AnyQuery, ...]:
        """List VXLAN links, bridges, and the forwarding entries of links of ours, as JSON."""
        return (
            Query(command="ip -j -d addr show", in_place=True),  # the facts ask the same, so it costs nothing
            Query(command=ENTRIES),
        )

    def parse(self, replies: Sequence[Reply]) -> tuple[Observed, ...]:
        """Return our links with their entries; a link of our name without alias is one that was half made."""
        every, entries = map(listed, replies)
        # each name once, and what belongs to it found at once: a robot may say anything, and pairs of it have no end
        links, bridges = (
            {string(item.get("ifname")): item for item in every if kind_of(item) == kind}
            for kind in ("vxlan", "bridge")
        )
        by_link = {string(one.get("ifname")): mappings(one.get("entries")) for one in entries}
        of_bridge: dict[str, dict[str, Any]] = {}
        found = []
        for name, item in links.items():
            alias = string(item.get("ifalias"))
            if not (alias.startswith(_ALIAS) or name.startswith(_PREFIX)):
                continue
            state = link_state(item, by_link.get(name, ()))
            if (on := state["bridge"]) not in of_bridge:
                of_bridge[on] = bridge_state(on, bridges.get(on, {}))
            instance = alias.removeprefix(_ALIAS) if alias.startswith(_ALIAS) else ""
            state = {**state, **of_bridge[on], "instance": instance}
            found.append(Observed(module="vxlan", name=name, instance=instance, state=state))
        return (*found, *isolated(every, bridges))

    def check(self, name: str, want: VxlanParams, found: State | None) -> Change | None:
        """Compare; what the kernel cannot change in place makes it a replacement."""
        if found is None or ISOLATED in found:
            cause = "not there" if found is None else "isolated since reboot"
            return Change(action=Action.CREATE, cause=cause, commands=_script(name, want, new=True))
        fixed = [
            f"{key} is {found[key] or 'not set'}, not {getattr(want, key)}"
            for key in ("vni", "local", "port", "instance")
            if found[key] != getattr(want, key)
        ]
        if found["elsewhere"] != bool(want.netns):
            through = "another network namespace" if found["elsewhere"] else "the robot's own network"
            fixed.append(f"its packets go through {through}")
        if found["learning"]:
            fixed.append("learning is on")
        if found["source_ports"] != list(SOURCE_PORTS):
            fixed.append("it sends from ports that any user may take, which closed overlays do not let in")
        if fixed:
            remove = ["link", "del", "dev", name]
            commands = _script(name, want, remove, new=True, had=found["addresses"])
            return Change(action=Action.REPLACE, cause="; ".join(fixed), before=found, commands=commands)
        if loose := _loose_differences(want, found):
            commands = _script(name, want, new=False, known=known(want.bridge, found), had=found["addresses"])
            return Change(action=Action.UPDATE, cause="; ".join(loose), before=found, commands=commands)
        return None

    def is_plumbing(self, name: str) -> bool:
        """Be what the overlay is made of."""
        return True

    def removal(self, found: Observed) -> tuple[Command, ...]:
        """Delete the link; its entries go with it."""
        name = quote(found.name)
        return (Run(script=f"ip link show dev {name} >/dev/null 2>&1 || exit 0; ip link del dev {name}"),)

    def is_own(self, name: str, want: VxlanParams, names: Names) -> bool:
        """Compare names, and where packets go: to robots of the plan, or where only those are."""
        own = (name, want.bridge, want.instance) == (names.link, names.bridge, names.instance)
        return own and want.netns in ("", names.tunnel) and {*want.vteps} <= names.vteps

    def removed_before(self, other: str) -> bool:
        """Go before the bridge that it is a port of, and before what encrypts its packets."""
        return other in ("network", "wireguard")


def link_calls(name: str, want: VxlanParams) -> list[list[str]]:
    """Return the calls of ip(8) and bridge(8) that make a link which is not there, and its entries."""
    links = [["ip", *call] for call in _ip_calls(name, want, new=True, had=())]
    return [*links, *(["bridge", *call] for call in fdb_calls(name, (), want.fdb))]


def _script(
    name: str,
    want: VxlanParams,
    *first: list[str],
    new: bool,
    known: Collection[tuple[str, str]] = (),
    had: Sequence[str] | None = None,
) -> tuple[Command, ...]:
    """Return the one script that makes the link, or mends what differs.

    `known` are the entries that are there, `had` the addresses of services on the bridge, where they are known.
    """
    links = [*first, *_ip_calls(name, want, new=new, had=had)]
    entries = fdb_calls(name, known, want.fdb)
    wanted = rules_hash(want.vni, want.port, want.local, {vtep for _, vtep in want.fdb})
    guard = [closed_first(name, wanted)] if new and not want.netns and name.startswith(_PREFIX) else []
    notify = bridge_address.announcing(want.bridge, want.bridge_mac)
    return (Run(script="\n".join([*guard, *notify, *batch(["ip"], links), *batch(["bridge"], entries)])),)


def _ip_calls(name: str, want: VxlanParams, *, new: bool, had: Sequence[str] | None) -> list[list[str]]:
    links = []
    if new:
        kind = ["type", "vxlan", "id", str(want.vni), "local", want.local]
        where = ["link-netns", want.netns] if want.netns else []
        sending = ["srcport", *map(str, SOURCE_PORTS)]
        links.append(["link", "add", name, *where, *kind, "dstport", str(want.port), *sending, "nolearning"])
        links.append(["link", "set", "dev", name, "alias", _ALIAS + want.instance])
    links.append(["link", "set", "dev", name, "mtu", str(want.mtu), "master", want.bridge, "up"])
    links.append(["link", "set", "dev", name, "type", "bridge_slave", "learning", "off", "fdb_flush"])
    links.append(["link", "set", "dev", want.bridge, "type", "bridge", "mcast_snooping", "0"])
    return [*links, *bridge_address.calls(want.bridge, want.bridge_mac, want.addresses, had)]


def _loose_differences(want: VxlanParams, found: State) -> list[str]:
    causes = []
    if not found["up"]:
        causes.append("link is down")
    for key, word in (("bridge", "bridge"), ("mtu", "MTU")):
        if found[key] != getattr(want, key):
            causes.append(f"{word} is {found[key] or 'not set'}, not {getattr(want, key)}")
    if found["snooping"]:
        causes.append("multicast snooping is on")
    if found["port_learning"]:
        causes.append("the bridge learns what is behind it")
    wanted, there = entries_of(want.fdb), known(want.bridge, found)
    for where, ours in (("FDB", True), ("the bridge's FDB", False)):
        add, remove = (sum(bool(vtep) is ours for _, vtep in few) for few in (wanted - there, there - wanted))
        if (add or remove) and (ours or found["bridge"] == want.bridge):
            causes.append(f"{where}: {add} to add, {remove} to remove")
            break  # the bridge's follow those of the link
    return [*causes, *bridge_address.differences(want.bridge_mac, want.addresses, found)]
