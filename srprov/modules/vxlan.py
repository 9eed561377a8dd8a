"""VXLAN links: the port of a robot's bridge to all other robots of the instance.

Learning is off: the controller
knows every entry. The link's alias carries the instance, and the bridge's multicast snooping is off, since no
querier is there that would keep groups alive.

Source: Linux `vxlan` documentation, iproute2's ip-link(8) and bridge(8).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from srprov.modules.module import Module, Names
from srprov.resource import Action, Change, Observed, State
from srprov.untrusted import mappings, string
from srprov.wire import AnyQuery, Command, Query, Reply, Run, quote, sh

FLOOD = "00:00:00:00:00:00"
_ALIAS = "srprov:"
_PREFIX = "srpv"
_END = "_END_OF_CALLS_"
_PLAIN = re.compile(r"[\w.:@%+-]+", re.ASCII)


@dataclass(frozen=True, kw_only=True, slots=True)
class VxlanParams:
    """What a playbook says of a VXLAN link."""

    instance: str
    vni: int
    local: str
    """The VTEP's address."""
    port: int
    bridge: str
    mtu: int
    fdb: tuple[tuple[str, str], ...]
    """Pairs of MAC and VTEP; the all-zero MAC stands for head-end replication of broadcast and multicast."""


class VxlanModule(Module[VxlanParams]):
    """The module of kind `vxlan`."""

    kind = "vxlan"
    params = VxlanParams
    shares_round_trip = True

    def queries(self) -> tuple[AnyQuery, ...]:
        """List VXLAN links, bridges and the forwarding database, as JSON."""
        return (
            Query(command="ip -j -d addr show"),  # the facts ask the same, so it costs nothing
            Query(command="bridge -j fdb show"),
        )

    def parse(self, replies: Sequence[Reply]) -> tuple[Observed, ...]:
        """Return our links with their entries; a link of our name without alias is one that was half made."""
        every, entries = (mappings(_json(reply)) for reply in replies)
        links, bridges = ([item for item in every if _kind(item) == kind] for kind in ("vxlan", "bridge"))
        snooping = {string(item.get("ifname")): _data(item).get("mcast_snooping") for item in bridges}
        found = []
        for item in links:
            name, alias = string(item.get("ifname")), string(item.get("ifalias"))
            if not (alias.startswith(_ALIAS) or name.startswith(_PREFIX)):
                continue
            state = _link_state(item, entries)
            state["snooping"] = bool(snooping.get(state["bridge"], 1))
            instance = alias.removeprefix(_ALIAS) if alias.startswith(_ALIAS) else ""
            found.append(Observed(module="vxlan", name=name, instance=instance, state={**state, "instance": instance}))
        return tuple(found)

    def check(self, name: str, want: VxlanParams, found: State | None) -> Change | None:
        """Compare; what the kernel cannot change in place makes it a replacement."""
        if found is None:
            return Change(action=Action.CREATE, cause="not there", commands=_script(name, want, new=True))
        fixed = [
            f"{key} is {found[key] or 'not set'}, not {getattr(want, key)}"
            for key in ("vni", "local", "port", "instance")
            if found[key] != getattr(want, key)
        ]
        if found["learning"]:
            fixed.append("learning is on")
        if fixed:
            remove = ["link", "del", "dev", name]
            commands = _script(name, want, remove, new=True)
            return Change(action=Action.REPLACE, cause="; ".join(fixed), before=found, commands=commands)
        if loose := _loose_differences(want, found):
            commands = _script(name, want, new=False, known=[(mac, vtep) for mac, vtep in found["fdb"]])
            return Change(action=Action.UPDATE, cause="; ".join(loose), before=found, commands=commands)
        return None

    def removal(self, found: Observed) -> tuple[Command, ...]:
        """Delete the link; its entries go with it."""
        name = quote(found.name)
        return (Run(script=f"ip link show dev {name} >/dev/null 2>&1 || exit 0; ip link del dev {name}"),)

    def is_own(self, name: str, want: VxlanParams, names: Names) -> bool:
        """Compare names, and where packets go: to robots of the plan."""
        own = (name, want.bridge, want.instance) == (names.link, names.bridge, names.instance)
        return own and {want.local, *(vtep for _, vtep in want.fdb)} <= names.vteps

    def removed_before(self, other: str) -> bool:
        """Go before the bridge that it is a port of."""
        return other == "network"


def _script(
    name: str, want: VxlanParams, *first: list[str], new: bool, known: Sequence[tuple[str, str]] = ()
) -> tuple[Command, ...]:
    """Return the one script that makes the link, or mends what differs; `known` are the entries that are there."""
    links = [*first]
    if new:
        kind = ["type", "vxlan", "id", str(want.vni), "local", want.local]
        links.append(["link", "add", name, *kind, "dstport", str(want.port), "nolearning"])
        links.append(["link", "set", "dev", name, "alias", _ALIAS + want.instance])
    links.append(["link", "set", "dev", name, "mtu", str(want.mtu), "master", want.bridge, "up"])
    links.append(["link", "set", "dev", want.bridge, "type", "bridge", "mcast_snooping", "0"])
    entries = _fdb_calls(name, known, want.fdb)
    return (Run(script="\n".join([*_calls("ip", links), *_calls("bridge", entries)])),)


def _calls(program: str, calls: Sequence[Sequence[str]]) -> list[str]:
    """Return shell lines for calls of one program of iproute2, up to the first that fails.

    One process does them all. A line of its batch cannot quote everything, so words that are not plain get a process
    per call, and the shell's quotes.
    """
    if all(_PLAIN.fullmatch(word) for call in calls for word in call):
        return [f"{program} -batch - <<'{_END}' || exit", *(" ".join(call) for call in calls), _END] if calls else []
    return [f"{sh(program, *call)} || exit" for call in calls]


def _json(reply: Reply) -> object:
    return reply.json() if reply.ok else []


def _kind(item: Mapping[str, Any]) -> str:
    info = item.get("linkinfo")
    return string(info.get("info_kind")) if isinstance(info, Mapping) else ""


def _data(item: Mapping[str, Any]) -> Mapping[str, Any]:
    info = item.get("linkinfo")
    data = info.get("info_data") if isinstance(info, Mapping) else None
    return data if isinstance(data, Mapping) else {}


def _link_state(item: Mapping[str, Any], entries: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    data, name = _data(item), string(item.get("ifname"))
    flags = item.get("flags")
    fdb = sorted(
        [string(entry.get("mac")), string(entry.get("dst"))]
        for entry in entries
        if entry.get("ifname") == name and entry.get("dst")
    )
    return {
        "vni": data.get("id", 0),
        "local": string(data.get("local") or data.get("local6")),
        "port": data.get("port", 0),
        "learning": bool(data.get("learning", False)),
        "bridge": string(item.get("master")),
        "mtu": item.get("mtu", 0),
        "up": "UP" in flags if isinstance(flags, list) else False,
        "fdb": fdb,
    }


def _loose_differences(want: VxlanParams, found: State) -> list[str]:
    causes = []
    if not found["up"]:
        causes.append("link is down")
    for key, word in (("bridge", "bridge"), ("mtu", "MTU")):
        if found[key] != getattr(want, key):
            causes.append(f"{word} is {found[key] or 'not set'}, not {getattr(want, key)}")
    if found["snooping"]:
        causes.append("multicast snooping is on")
    wanted, there = set(want.fdb), {tuple(e) for e in found["fdb"]}
    if wanted != there:
        causes.append(f"FDB: {len(wanted - there)} to add, {len(there - wanted)} to remove")
    return causes


def _fdb_calls(name: str, known: Sequence[tuple[str, str]], wanted: Sequence[tuple[str, str]]) -> list[list[str]]:
    """Return calls of bridge(8). All-zero entries are appended (several may stand side by side), others replaced."""
    calls = [["fdb", "del", mac, "dev", name, "dst", vtep, "self"] for mac, vtep in sorted(set(known) - set(wanted))]
    for mac, vtep in sorted(set(wanted) - set(known)):
        verb = "append" if mac == FLOOD else "replace"
        calls.append(["fdb", verb, mac, "dev", name, "dst", vtep, "self", "permanent"])
    return calls
