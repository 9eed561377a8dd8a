"""Interfaces, routes, and the underlay: which of a robot's addresses other robots reach.

Takes what `ip -j` says and the inventory's wishes; gives Links and an Underlay. Pure. The underlay carries the
overlay's VXLAN, so its address must be one that other robots can send to: never loopback, never Docker's networks,
never our own.
Source: ip-address(8), ip-route(8), RFC 7348 (VTEP).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from ipaddress import IPv4Address, IPv4Network, IPv6Address, ip_address, ip_interface
from typing import Any

import msgspec
from msgspec.structs import replace

from srprov.definitions.model import Host
from srprov.facts.model import Link
from srprov.untrusted import LIST_LENGTH, integer, json_or_none, lines_of, mapping, mappings, text

_NAME = re.compile(r"[^\s/\x00-\x1f\x7f]{1,15}")
_MAC = re.compile(r"[0-9a-f]{2}(:[0-9a-f]{2}){5}")
_FOREIGN = re.compile(r"lo|docker[0-9]*|docker_gwbridge|br-[0-9a-f]{12}|srp[vb].*")
"""Names of loopback, of Docker's bridges, of ours (which the alias also tells)."""
_MOST_ADDRESSES = 4 * LIST_LENGTH
"""Of all interfaces: each is compared with the networks of others."""
_FOREIGN_KINDS = ("vxlan", "dummy", "ifb")

Address = IPv4Address | IPv6Address


class Underlay(msgspec.Struct, frozen=True, kw_only=True):
    """The interface and address (no prefix) that other robots reach; empty where none was found."""

    link: str = ""
    address: str = ""
    mtu: int = 1500


class _Candidate(msgspec.Struct, frozen=True):
    link: Link
    address: Address


def parse_links(out: str) -> tuple[Link, ...]:
    """Read `ip -j -d addr show`, sorted by name, speeds not yet known; what has no proper name is left out."""
    found: dict[str, Link] = {}
    left = _MOST_ADDRESSES
    for item in mappings(json_or_none(out), most=LIST_LENGTH):
        name = item.get("ifname")
        if isinstance(name, str) and _NAME.fullmatch(name) and name.isprintable() and name not in found:
            found[name] = _link(name, item, left)
            left -= len(found[name].addresses)
    return tuple(found[name] for name in sorted(found))


HIDDEN = """\
for n in /run/docker/netns/1-*; do
  [ ! -e "$n" ] || nsenter --net="$n" ip -j -d link show type vxlan 2>/dev/null
done
:"""
"""Shows the VXLAN links of Docker Swarm's overlays, which it keeps in network namespaces of their own. The kernel has
their VNIs count in the robot's, where they were made. Only root may look."""


def parse_hidden(out: str) -> tuple[Link, ...]:
    """Read the answer to `HIDDEN`, a list in each line; the links get names of their own."""
    items = [one for line in lines_of(out, LIST_LENGTH) for one in mappings(json_or_none(line), most=LIST_LENGTH)]
    found = (_link(f"swarm-{number}", item, 0) for number, item in enumerate(items[:LIST_LENGTH], 1))
    return tuple(replace(link, up=False, alias="") for link in found if link.kind == "vxlan")


def _link(name: str, item: Mapping[str, Any], most: int) -> Link:
    flags, info = item.get("flags"), mapping(item.get("linkinfo"))
    mac, data = text(item.get("address"), length=17), mapping(info.get("info_data"))
    kind = text(info.get("info_kind"), length=16)
    return Link(
        name=name,
        mtu=integer(item.get("mtu"), low=0, high=2**24, default=1500),
        up=isinstance(flags, list) and "UP" in flags,
        mac=mac if _MAC.fullmatch(mac) else "",
        kind=kind,
        addresses=tuple(_addresses(item.get("addr_info"), most)),
        vni=integer(data.get("id"), low=0, high=2**24 - 1, default=0) if kind == "vxlan" else 0,
        port=integer(data.get("port"), low=0, high=65535, default=0) if kind == "vxlan" else 0,
        alias=text(item.get("ifalias")),
    )


def _addresses(items: object, most: int) -> Iterable[str]:
    for item in mappings(items, most=most):
        whole = f"{text(item.get('local'), length=45)}/{integer(item.get('prefixlen'), low=0, high=128, default=-1)}"
        # An address that is not usable yet, or being phased out, is none to build on.
        if item.get("tentative") or item.get("deprecated") or item.get("dadfailed"):
            continue
        # Behind the % of a scope ipaddress takes any text: blanks and quotes too. No address of an underlay has one.
        if "%" in whole:
            continue
        try:
            yield str(ip_interface(whole))
        except ValueError:
            continue


class Routes(msgspec.Struct, frozen=True, kw_only=True):
    """The main table, IPv4."""

    destinations: tuple[str, ...] = ()
    """As CIDR, sorted; the default route is `0.0.0.0/0`."""
    default_links: tuple[str, ...] = ()
    """Interfaces of default routes, best metric first."""
    gateways: tuple[str, ...] = ()
    """Addresses of whatever routes go through, as the robot says them."""


def parse_routes(out: str) -> Routes:
    """Read `ip -j -4 route show`; entries that are no network are left out."""
    destinations: set[IPv4Network] = set()
    defaults: list[tuple[int, int, str]] = []
    gateways: list[str] = []
    for item in mappings(json_or_none(out), most=LIST_LENGTH):
        hops = (item, *mappings(item.get("nexthops"), most=LIST_LENGTH))
        gateways += [gateway for hop in hops if (gateway := text(hop.get("gateway"), length=45))]
        target = item.get("dst")
        target = "0.0.0.0/0" if target == "default" else text(target, length=18)
        try:
            destinations.add(IPv4Network(target, strict=False))
        except ValueError:
            continue
        if target == "0.0.0.0/0":
            metric = integer(item.get("metric"), low=0, high=2**32, default=0)
            defaults.append((metric, len(defaults), text(item.get("dev"), length=15)))
    return Routes(
        destinations=tuple(str(network) for network in sorted(destinations)),
        default_links=tuple(link for _, _, link in sorted(defaults)),
        gateways=tuple(gateways[:LIST_LENGTH]),
    )


def find_underlay(host: Host, links: Sequence[Link], routes: Routes, reached_at: str) -> Underlay:
    """Choose the underlay.

    In this order: what the inventory says; where SSH reached it (`reached_at`, the robot's end of the connection); the
    inventory's address of it; the interface of the default route; the only interface that qualifies. What the inventory
    says is never overruled: when that is not there, or is loopback, Docker's or ours, the answer is empty.
    """
    usable = [link for link in links if _qualifies(link)]
    all_of = [_Candidate(link, address) for link in usable for address in _usable_addresses(link)]
    if host.underlay:
        return _first(_named(all_of, host.underlay))
    by_route = [c for name in routes.default_links for c in all_of if c.link.name == name and c.link.up]
    alone = [c for c in all_of if c.link.up]
    choices: tuple[Callable[[], list[_Candidate]], ...] = (
        lambda: [] if host.connection == "local" else _holding(all_of, reached_at),
        lambda: _holding(all_of, host.address),
        lambda: by_route,
        lambda: alone if len({c.link.name for c in alone}) == 1 else [],
    )
    return next((_first(found) for choice in choices if (found := choice())), Underlay())


def _qualifies(link: Link) -> bool:
    ours = link.alias.startswith("srprov:") or link.kind in _FOREIGN_KINDS
    return not (ours or _FOREIGN.fullmatch(link.name))


def is_a_hosts(address: Address) -> bool:
    """Return whether an address may be one host's for others; not that of whoever asks, of all, or of none.

    An IPv6 address that holds an IPv4 one is none that a robot has.
    """
    if isinstance(address, IPv6Address) and address.ipv4_mapped is not None:
        return False
    limited = address.version == 4 and address.is_reserved
    return not (address.is_loopback or address.is_multicast or address.is_unspecified or limited)


def _usable_addresses(link: Link) -> list[Address]:
    found = [ip_interface(address).ip for address in link.addresses]
    # A link-local IPv6 address means nothing without its interface; IPv4's is all that robots without DHCP have: last.
    fit = [a for a in found if is_a_hosts(a) and not (a.version == 6 and a.is_link_local)]
    return sorted(fit, key=lambda a: (a.version, a.is_link_local))


def _named(candidates: list[_Candidate], wish: str) -> list[_Candidate]:
    by_link = [c for c in candidates if c.link.name == wish]
    return by_link or _holding(candidates, wish.partition("/")[0])


def _holding(candidates: list[_Candidate], address: str) -> list[_Candidate]:
    try:
        wanted = ip_address(address.partition("%")[0])
    except ValueError:
        return []
    if isinstance(wanted, IPv6Address) and wanted.ipv4_mapped:
        wanted = wanted.ipv4_mapped  # sshd on a dual-stack socket
    return [c for c in candidates if c.address == wanted]


def _first(candidates: list[_Candidate]) -> Underlay:
    if not candidates:
        return Underlay()
    best = candidates[0]
    return Underlay(link=best.link.name, address=str(best.address), mtu=best.link.mtu)
