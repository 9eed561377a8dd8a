"""What a robot says of its encrypted overlays: one network namespace each, with WireGuard interfaces in it. Pure.

An interface is made in the robot's own network, where its UDP socket stays, and moved into the namespace, where the
VXLAN link's socket is. So nothing on the robot or its LAN can send VXLAN to the overlay, only peers can; and addresses
and routes in there meet nothing of the robot's own. The namespace's owner is the alias of its `lo`.

Nothing here ever asks for a private key: `wg show INTERFACE dump` would tell it.
Source: wg(8), ip-netns(8), https://www.wireguard.com/netns/.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from ipaddress import IPv4Address
from typing import Any

from srprov.modules.params import ParameterError
from srprov.untrusted import LIST_LENGTH, integer, json_or_none, lines_of, mappings, string
from srprov.wire import Query, Reply

NAME = "srpw"
"""The beginning of each name."""
NETNS = re.compile(rf"{NAME}[0-9a-f]{{8}}")
LINK = re.compile(rf"({NETNS.pattern})[ab]")
"""Two, so that a new key is in use on all robots before the old one goes."""
KEY = re.compile(r"[A-Za-z0-9+/]{42}[AEIMQUYcgkosw048]=")
"""32 bytes in base64."""
ALIAS = "srprov:"
_WORDS = ("public-key", "listen-port", "endpoints", "allowed-ips", "latest-handshakes")
_LIVELY_S = 180
"""A peer that is sent to is shaken hands with every two minutes. Source: the WireGuard paper, section 6.1."""
_MOST_LINES = 16 * LIST_LENGTH
_MOST_WORDS = 8
"""Of a line of `wg show all`: names of interfaces without peers, one with, a key and its value."""

QUERIES = (
    Query(command="ip -j -d addr show", in_place=True),  # the facts ask the same, so it costs nothing
    Query(
        command=f"""\
for n in /run/netns/srpw*; do
  [ -e "$n" ] || continue
  n=${{n##*/}}
  printf 'netns %s\\nlinks ' "$n"; ip -j -d -n "$n" addr show
  printf '\\nroutes '; ip -j -n "$n" -4 route show
  printf '\\n'; date +'clock %s'
  for w in {" ".join(_WORDS)}; do echo "show $w"; ip netns exec "$n" wg show all "$w"; done
done
:""",
        in_place=True,
    ),
)
"""Where there is none, no program is started for the second."""


def check_addresses(parameter: str, *addresses: str) -> None:
    """Refuse (ParameterError) what is no IPv4 address in its plain form."""
    for one in addresses:
        try:
            plain = one != "" and str(IPv4Address(one)) == one
        except ValueError:
            plain = False
        if not plain:
            raise ParameterError(parameter, f"'{one}' is no IPv4 address")


@dataclass(slots=True)
class Interface:
    """A WireGuard interface as it was found."""

    mtu: int = 0
    up: bool = False
    inside: bool = False
    """It is in its namespace: false for one that was half made."""
    alias: str = ""
    public: str = ""
    port: int = 0
    peers: dict[str, list[str]] = field(default_factory=dict)
    """Public key -> endpoint, then what it may send from."""
    lively: set[str] = field(default_factory=set)
    """Keys of peers that shook hands a moment ago."""


@dataclass(slots=True)
class Tunnels:
    """A namespace as it was found."""

    name: str
    instance: str = ""
    address: str = ""
    """Of its `lo`, where VXLAN comes from and goes to; several are joined by a blank."""
    through: dict[str, str] = field(default_factory=dict)
    """Address -> the interface that its route goes through."""
    interfaces: dict[str, Interface] = field(default_factory=dict)


def read(replies: Sequence[Reply]) -> tuple[Tunnels, ...]:
    """Read the replies to `QUERIES`."""
    found: dict[str, Tunnels] = {}
    shown = _Shown()
    for line in lines_of(replies[1].out, _MOST_LINES):
        word, _, rest = line.partition(" ")
        if word == "netns" and NETNS.fullmatch(rest):
            current = found.setdefault(rest, Tunnels(rest))
        elif not found:
            continue
        elif word == "links":
            _read_links(current, json_or_none(rest))
        elif word == "routes":
            current.through |= _routes(json_or_none(rest))
        elif word == "clock":
            shown.clock = integer(rest)
        elif word == "show":
            shown.word = rest
        else:
            shown.line(current, line.split("\t", _MOST_WORDS)[:_MOST_WORDS])
    # three modules read the same long answer, which hardly ever has a word of theirs
    links = replies[0].json() if replies[0].ok and NAME in replies[0].out else []
    for item in mappings(links, most=LIST_LENGTH):
        if match := LINK.fullmatch(string(item.get("ifname"))):
            half_made = found.setdefault(match[1], Tunnels(match[1]))
            half_made.interfaces[match[0]] = Interface(alias=string(item.get("ifalias")).removeprefix(ALIAS))
    return tuple(found.values())


def _read_links(one: Tunnels, links: object) -> None:
    for item in mappings(links, most=LIST_LENGTH):
        name, flags = string(item.get("ifname")), item.get("flags")
        if name == "lo":
            one.instance = string(item.get("ifalias")).removeprefix(ALIAS)
            inner = [a for a in mappings(item.get("addr_info"), most=LIST_LENGTH) if a.get("scope") == "global"]
            one.address = " ".join(sorted(string(address.get("local")) for address in inner))
        elif name.startswith(one.name) and LINK.fullmatch(name):
            up = isinstance(flags, list) and "UP" in flags
            one.interfaces[name] = Interface(mtu=integer(item.get("mtu"), high=2**24), up=up, inside=True)


def _routes(routes: object) -> dict[str, str]:
    items = mappings(routes, most=LIST_LENGTH)
    return {string(item.get("dst")): string(item.get("dev")) for item in items}


class _Shown:
    """Reads what `wg show all` prints, word by word.

    Of peers it names the interface only before the first one; and one that has none, before the next interface.
    """

    def __init__(self) -> None:
        self.word, self.clock = "", 0
        self._last: Interface | None = None

    def line(self, one: Tunnels, words: list[str]) -> None:
        """Take the words of a line."""
        if self.word in ("public-key", "listen-port"):
            link, value = one.interfaces.get(words[0]), words[-1]
            if link is not None and self.word == "public-key":
                link.public = value if KEY.fullmatch(value) else ""
            elif link is not None:
                link.port = integer(value, high=65535)
            return
        while words and not KEY.fullmatch(words[0]):
            self._last, words = one.interfaces.get(words[0]), words[1:]
        if self._last is None or len(words) != 2:
            return
        if self.word == "latest-handshakes" and self.clock - integer(words[1]) < _LIVELY_S:
            self._last.lively.add(words[0])
        elif self.word in ("endpoints", "allowed-ips") and len(self._last.peers) < LIST_LENGTH:
            self._last.peers.setdefault(words[0], []).append(string(words[1]))


def links_of(replies: Sequence[Reply]) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Yield instance, name and state of every interface, and of the first one of a namespace that has none."""
    for one in read(replies):
        for name, link in sorted((one.interfaces or {f"{one.name}a": Interface()}).items()):
            state = {
                "address": one.address,
                "inside": link.inside,
                "listen_port": link.port,
                "mtu": link.mtu,
                "public": link.public,
                "up": link.up,
            }
            yield one.instance or link.alias, name, state
