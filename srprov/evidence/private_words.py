"""What of a lab is nobody else's business, and what stands for it in a bundle: addresses, names of hosts and users.

Takes a session's facts, inventory and environment as JSON; gives words and what stands for each. Pure. An address
becomes one of those for documentation, so that every format stays what it is; a host's name the robot's; equal words
are replaced by equal ones in all files.

Source: RFC 2544, RFC 3849, RFC 5737 and RFC 7042: addresses that nobody has.
"""

from __future__ import annotations

import ipaddress
import posixpath
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from srprov.linear_regex import any_of
from srprov.untrusted import mapping, mappings, string, string_map, strings

SHORTEST = 4
"""Characters of a host's name that is replaced: a shorter one stands in too many other words."""
_MAC = re.compile(r"(?:[0-9a-f]{2}:){5}[0-9a-f]{2}", re.IGNORECASE)
_MACHINE = re.compile(r"[0-9a-f]{32}")
_HOME = re.compile(r"(?<![\w.])/home/(?!user(?![\w.-]))[\w.-]+")
_OWN = re.compile(r"(?:00:){5}00|(?:ff:){5}ff", re.IGNORECASE)
_ADDRESS = re.compile(
    r"(?<![\w.])(?:\d{1,3}(?:\.\d{1,3}){3}|(?:[0-9a-f]{2}:){5}[0-9a-f]{2}|[0-9a-f]{0,4}(?::[0-9a-f]{0,4}){2,7})(?!\w|\.\w)",
    re.IGNORECASE | re.ASCII,
)
"""What may be an IPv4, MAC or IPv6 address."""


@dataclass(slots=True)
class Words:
    """Words -> what stands for them. One that `stays` is replaced nowhere, whoever says that it is private."""

    stays: Callable[[str], bool] = lambda _word: False
    found: dict[str, str] = field(default_factory=dict)
    kinds: dict[str, int] = field(default_factory=dict)
    """How many words of a kind there are."""

    def add(self, kind: str, word: str, instead: str = "") -> None:
        """Take a word, once; where nothing is said to stand for it, an address nobody has does, or its kind."""
        if word and word not in self.found and word != instead and not self.stays(word):
            number = self.kinds[kind] = self.kinds.get(kind, 0) + 1
            self.found[word] = instead or (_ADDRESSES[kind](number) if kind in _ADDRESSES else kind)

    def address(self, text: str) -> None:
        """Take an IP address, with or without the length of its network; what is none, or no host's, is not taken."""
        word = text.partition("/")[0]
        try:
            one = ipaddress.ip_address(word)
        except ValueError:
            return
        if not (one.is_loopback or one.is_unspecified or one.is_multicast):
            self.add(f"ipv{one.version}", word.lower())


def _ipv4(number: int) -> str:
    nets = ("192.0.2", "198.51.100", "203.0.113")
    if number <= 254 * len(nets):
        return f"{nets[(number - 1) // 254]}.{(number - 1) % 254 + 1}"
    return str(ipaddress.ip_address("198.18.0.0") + number)


def _mac(number: int) -> str:
    head = "00:00:5e:00:53" if number <= 255 else f"02:00:5e:{number >> 16 & 255:02x}:{number >> 8 & 255:02x}"
    return f"{head}:{number & 255:02x}"


_ADDRESSES = {"ipv4": _ipv4, "ipv6": lambda number: f"2001:db8::{number:x}", "mac": _mac}


class Replacer:
    """Replaces words in texts, and counts how often."""

    def __init__(self, words: Words) -> None:
        """Take what is replaced."""
        self._words, self._stays = words.found, words.stays
        names = sorted(
            (word for word in words.found if not _ADDRESS.fullmatch(word)), key=lambda word: (-len(word), word)
        )
        every = "|".join(map(re.escape, names))
        self._names = re.compile(rf"(?<![\w.])(?:{every})(?!\w|[.-]\w)") if names else None
        self._any = any_of([f"(?i:{re.escape(word)})" for word in sorted(words.found)] + ["/home/"])
        self.count = 0

    def line(self, line: bytes) -> bytes:
        """Return a line of a file with what stands for its private words; most lines have none."""
        if self._any is not None and not self._any(line):
            return line
        return self.text(line.decode("utf-8", "surrogateescape")).encode("utf-8", "surrogateescape")

    def text(self, text: str) -> str:
        """Return a text with what stands for its private words."""
        if self._names is not None:
            text = self._names.sub(lambda match: self._counted(self._words[match[0]]), text)
        text = _ADDRESS.sub(self._address, text)
        return _HOME.sub(self._home, text)

    def _counted(self, instead: str) -> str:
        self.count += 1
        return instead

    def _home(self, match: re.Match[str]) -> str:
        return match[0] if self._stays(match[0]) else self._counted("/home/user")

    def _address(self, match: re.Match[str]) -> str:
        word = match[0].lower()
        return self._counted(self._words[word]) if word in self._words else match[0]


def replaceable(text: str) -> set[str]:
    """Return what of a text a `Replacer` may take for an address or a home, without case."""
    return {one.casefold() for pattern in (_ADDRESS, _HOME) for one in pattern.findall(text)}


def collect(
    words: Words, may_hide: Callable[[str], bool], facts: Mapping[str, Any], inventory: Mapping[str, Any],
    environment: Mapping[str, Any], hardware: Mapping[str, Any], inputs: Mapping[str, Any],
) -> None:  # fmt: skip
    """Add the private words of a session, in an order that follows from the files alone.

    `may_hide` tells whether what a robot says is its name means nothing else in the bundle.
    """
    for robot, one in sorted(mapping(facts.get("robots")).items()):
        _of_robot(words, robot, mapping(one), may_hide)
    for robot, host in sorted(_hosts(inventory)):
        address = string(host.get("ansible_host"))
        words.address(address)
        if address != robot and "." in address and not any(part.isdecimal() for part in address.split(".")[-1:]):
            words.add("hostname", address, robot)
    for word, token in sorted(string_map(hardware.get("tokens")).items()):
        if _MACHINE.fullmatch(word):  # other serial numbers may be any number: they are replaced where they stand
            words.add("machine", word, token)
    owner = string(environment.get("owner"))
    words.add("user", owner, "user@controller" if "@" in owner else "")
    folder = string(mapping(environment.get("source")).get("file")).rpartition("/")[0]
    if len(folder) >= SHORTEST:
        words.add("folder", folder, "/experiment")
    for path in (string(one.get("path")) for one in mappings(inputs.get("files"))):
        if folder and path.startswith(".."):
            words.add("folder", posixpath.normpath(f"{folder}/{path}"), f"/experiment/{path}")


def _of_robot(words: Words, robot: str, one: Mapping[str, Any], may_hide: Callable[[str], bool]) -> None:
    for text in (*_addresses(one), *strings(one.get("routes")), *strings(one.get("relies_on"))):
        words.address(text)
    for line in strings(one.get("hosts")):
        words.address(line.partition(" ")[0])
    words.address(string(one.get("underlay_address")))
    for link in mappings(one.get("links")):
        mac = string(link.get("mac"))
        if _MAC.fullmatch(mac) and not _OWN.fullmatch(mac):
            words.add("mac", mac.lower())
    host = string(one.get("hostname"))
    if len(host) >= SHORTEST and may_hide(host):
        words.add("hostname", host, robot)


def _addresses(one: Mapping[str, Any]) -> Iterator[str]:
    for link in mappings(one.get("links")):
        yield from strings(link.get("addresses"))


def _hosts(inventory: Mapping[str, Any]) -> Iterable[tuple[str, Mapping[str, Any]]]:
    hosts = mapping(mapping(inventory.get("all")).get("hosts"))
    return ((string(name), mapping(host)) for name, host in hosts.items())


def without_access(inventory: Mapping[str, Any]) -> dict[str, Any]:
    """Return an inventory without what says how robots are entered: users, ports, keys and options of SSH."""
    every = mapping(inventory.get("all"))
    hosts = {name: {key: value for key, value in host.items() if _is_told(key)} for name, host in _hosts(inventory)}
    return {"all": {**every, "hosts": hosts}}


def _is_told(key: str) -> bool:
    return key == "ansible_host" or key.startswith("srprov_")


def without_user(facts: Mapping[str, Any], tokens: Mapping[str, str]) -> dict[str, Any]:
    """Return a facts document without the users and names of the robots' own, and with tokens for serial numbers."""
    robots = {}
    for name, one in mapping(facts.get("robots")).items():
        about = mapping(one)
        serials = [serial.partition(" ") for serial in strings(about.get("serials"))]
        robots[name] = {
            **about,
            "user": "",
            "hosts": [],
            "homes": [],
            "machine_id": tokens.get(string(about.get("machine_id")), ""),
            "serials": [f"{kind} {tokens[word]}" for kind, _, word in serials if word in tokens],
        }
    return {**facts, "robots": robots}
