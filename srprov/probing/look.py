"""A closer look at a robot on which something fails: its links, forwarding and ARP entries, and firewall. Pure.

Takes what `ip -j`, `bridge -j`, iptables-save and nft say; gives a `Look`. What has another shape counts as not said.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType

import msgspec

from srprov.network.identity import tunnel_name
from srprov.probing.firewall import RULES, Rule, parse_rules
from srprov.probing.model import Request
from srprov.untrusted import integer, mapping, mappings, text
from srprov.wire import Query, Reply, quote

_MOST_INSIDE = 16
"""Namespaces of containers that are looked into on a robot."""
_MOST = 8192
"""Entries of a kind."""


class LinkSeen(msgspec.Struct, frozen=True, kw_only=True):
    """One interface."""

    name: str
    index: int = 0
    peer: int = 0
    """Index of a veth's other end."""
    up: bool = True
    mtu: int = 0
    mac: str = ""
    master: str = ""
    port_state: str = ""
    """Of a bridge's port: `forwarding`, `disabled`...; empty: it is none."""
    addresses: tuple[str, ...] = ()


class Inside(msgspec.Struct, frozen=True, kw_only=True):
    """A network namespace."""

    links: tuple[LinkSeen, ...] = ()
    neighbours: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Address -> MAC."""

    def by_name(self, name: str) -> LinkSeen | None:
        """Return a link."""
        return next((one for one in self.links if one.name == name), None)

    def with_address(self, address: str) -> LinkSeen | None:
        """Return the link that has an address."""
        return next((one for one in self.links if address in one.addresses), None)


class Look(msgspec.Struct, frozen=True, kw_only=True):
    """One robot."""

    host: Inside = msgspec.field(default_factory=Inside)
    inside: Mapping[int, Inside] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Endpoint's index -> its container's namespace."""
    fdb: frozenset[tuple[str, str]] | None = None
    """MAC and VTEP of the overlay's link; None: not said."""
    rules: tuple[Rule, ...] = ()
    tunnel: Inside | None = None
    """Where an encrypted overlay has its WireGuard interfaces; None: it is not there."""


def queries(request: Request, robot: str, namespaces: Mapping[int, int]) -> tuple[Query, ...]:
    """Return what to ask a robot."""
    asked = ["ip -j -d addr show", "ip -j neigh show", f"bridge -j fdb show dev {quote(request.link)}", RULES]
    asked += [f"ip -j -d -n {quote(tunnel_name(request.instance))} addr show"] if request.tunnel_port else []
    for pid in _inside(request, robot, namespaces).values():
        enter = f"nsenter --net=/proc/{pid}/ns/net"
        asked += [f"{enter} ip -j -d addr show", f"{enter} ip -j neigh show"]
    return tuple(Query(command=one) for one in asked)


def parse_look(replies: Sequence[Reply], request: Request, robot: str, namespaces: Mapping[int, int]) -> Look:
    """Read the replies to `queries` with the same arguments."""
    every = [reply.json() if reply.ok else None for reply in replies]
    entries = None
    if isinstance(every[2], list):
        entries = frozenset(
            (text(one.get("mac"), length=17), text(one.get("dst"), length=45))
            for one in mappings(every[2], most=_MOST)
            if one.get("dst")
        )
    first = 5 if request.tunnel_port else 4
    inside = {
        at: _namespace(every[first + 2 * number], every[first + 1 + 2 * number])
        for number, at in enumerate(_inside(request, robot, namespaces))
    }
    rules = parse_rules(replies[3].out)
    tunnel = _namespace(every[4], None) if request.tunnel_port and isinstance(every[4], list) else None
    return Look(host=_namespace(every[0], every[1]), inside=inside, fdb=entries, rules=rules, tunnel=tunnel)


def _inside(request: Request, robot: str, namespaces: Mapping[int, int]) -> dict[int, int]:
    mine = [at for at in request.of(robot) if at in namespaces]
    return {at: namespaces[at] for at in mine[:_MOST_INSIDE]}


def _namespace(links: object, neighbours: object) -> Inside:
    return Inside(
        links=tuple(_links(links)),
        neighbours={
            text(one.get("dst"), length=45): text(one.get("lladdr"), length=17)
            for one in mappings(neighbours, most=_MOST)
            if one.get("lladdr")
        },
    )


def _links(value: object) -> Iterator[LinkSeen]:
    for item in mappings(value, most=_MOST):
        info, flags = mapping(item.get("linkinfo")), item.get("flags")
        slave = mapping(info.get("info_slave_data")) if info.get("info_slave_kind") == "bridge" else {}
        yield LinkSeen(
            name=text(item.get("ifname"), length=15),
            index=integer(item.get("ifindex")),
            peer=integer(item.get("link_index")),
            up="UP" in flags if isinstance(flags, list) else True,
            mtu=integer(item.get("mtu"), high=2**24),
            mac=text(item.get("address"), length=17),
            master=text(item.get("master"), length=15),
            port_state=text(slave.get("state"), length=16),
            addresses=tuple(text(one.get("local"), length=45) for one in mappings(item.get("addr_info"), most=64)),
        )
