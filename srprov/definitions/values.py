"""Scalars -> figures: durations in seconds, sizes in bytes, ports, command words.

Takes text that the schema has already looked at; gives plain values, or raises ValueError in words for the user. Pure.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TypeVar

from srprov.codes import Code
from srprov.definitions import commandline, words
from srprov.definitions.containermodel import LINK_PORTS, VXLAN_PORT, Port, of_links
from srprov.published import may_be_published_at
from srprov.yamldoc import nodes
from srprov.yamldoc.nodes import Findings, Map, Node, Path, Scalar, Seq

_DURATION = re.compile(r"([0-9]+(?:\.[0-9]+)?)(us|ms|s|m|h)", re.ASCII)
_SECONDS = {"us": 1e-6, "ms": 1e-3, "s": 1.0, "m": 60.0, "h": 3600.0}
_LONGEST_COMMAND = 100_000
"""Characters; no kernel takes a longer word."""
_LONGEST_S = 24 * 3600.0
MOST_PORTS = 1000
"""That a service may publish, as Docker starts a process for each, and that it may expose."""
_PORT = re.compile(
    r"(?:(?P<address>\[[0-9a-fA-F:]+\]|[0-9]+(?:\.[0-9]+){3}):)?"
    r"(?:(?P<published>[0-9-]+):)?(?P<inside>[0-9-]+)(?:/(?P<kind>tcp|udp))?",
    re.ASCII,
)

T = TypeVar("T")
Device = tuple[str, str, str]


def text(node: Node | None, default: str = "") -> str:
    """Return a scalar's text, or the default where nothing stands."""
    return node.text if isinstance(node, Scalar) else default


def texts(node: Node | None) -> tuple[str, ...]:
    """Return a list's texts; a single text counts as a list of one."""
    return tuple(item.text for item in scalars(node))


def scalars(node: Node | None) -> tuple[Scalar, ...]:
    """Return a list's scalars; a single scalar counts as a list of one."""
    if isinstance(node, Seq):
        return tuple(item for item in node.items if isinstance(item, Scalar))
    return (node,) if isinstance(node, Scalar) else ()


def text_map(node: Node | None) -> dict[str, str]:
    """Return a map of texts."""
    entries = node.entries if isinstance(node, Map) else {}
    return {key: text(value) for key, value in entries.items()}


def flag(node: Node | None) -> bool:
    """Return a boolean, false where nothing stands."""
    return node is not None and bool(nodes.as_bool(node))


def guarded(reader: Callable[[Node], T], node: Node, default: T, findings: Findings, path: Path) -> T:
    """Return what a reader makes of a value, or the default, with what it raises (ValueError) added to the findings."""
    try:
        return reader(node)
    except ValueError as error:
        findings.add(node, str(error), path, code=Code.WRONG_VALUE)
        return default


def duration(written: str) -> float:
    """Read `1m30s` as seconds.

    Raises:
        ValueError: It is longer than a day; clocks and timers overflow somewhere beyond that.
    """
    seconds = sum(float(count) * _SECONDS[unit] for count, unit in _DURATION.findall(written))
    if not seconds <= _LONGEST_S:
        raise ValueError(f"'{written[:40]}' is longer than 24h")
    return seconds


def command_words(node: Node) -> tuple[str, ...]:
    """Read a command that is run here: a list as it is, text split like a shell's command line."""
    return _words(node, words.split)


def container_words(node: Node) -> tuple[str, ...]:
    """Read a container's command: a list as it is, text split as Compose does."""

    def split(text: str) -> tuple[str, ...]:
        found, rest = commandline.split(text)
        if rest:
            raise ValueError(f"ends at '{rest[0]}', as no shell runs it; write sh -c '...', or a list of words")
        return found

    return _words(node, split)


def _words(node: Node, split: Callable[[str], tuple[str, ...]]) -> tuple[str, ...]:
    if not isinstance(node, Scalar):
        return texts(node)
    if len(node.text) > _LONGEST_COMMAND:
        raise ValueError(f"is longer than {_LONGEST_COMMAND} characters")
    try:
        return split(node.text)
    except ValueError as error:
        raise ValueError(f"cannot be split into words: {str(error)[:1].lower()}{str(error)[1:]}") from None


def device(spec: str) -> Device:
    """Read `robot-path[:container-path[:rwm]]`."""
    parts = spec.split(":")
    if len(parts) == 2 and not parts[1].startswith("/"):
        parts.insert(1, parts[0])
    inside = parts[1] if len(parts) > 1 else parts[0]
    return parts[0], inside, parts[2] if len(parts) > 2 else "rwm"


def ports(spec: str) -> tuple[Port, ...]:
    """Read `[address:][published:]container[/protocol]`; ranges give one entry per port."""
    match = _PORT.fullmatch(spec)
    if match is None:
        raise ValueError(f"'{spec[:60]}' is no port mapping")
    inside = _range(match["inside"])
    published = _range(match["published"]) if match["published"] else inside
    if len(inside) > MOST_PORTS:
        raise ValueError(f"'{spec}' publishes {len(inside)} ports; {MOST_PORTS} are the most")
    if len(inside) != len(published):
        raise ValueError(f"'{spec}' maps {len(published)} ports to {len(inside)}")
    address = (match["address"] or "").strip("[]")
    if address:
        import ipaddress

        given = ipaddress.ip_address(address)
        # one address has one spelling, so that equal ones are seen to be
        address = str(getattr(given, "ipv4_mapped", None) or given)
    if not may_be_published_at(address):
        what = "is published where others may have it: at an address of IPv6 alone, or at none of a host's"
        raise ValueError(f"'{spec}' {what}; name one of IPv4 that the robot has, or none")
    kind = match["kind"] or "tcp"
    found = tuple((address, out, into, kind) for out, into in zip(published, inside, strict=True))
    if any(map(of_links, found)):
        low, high = LINK_PORTS[0], LINK_PORTS[-1]
        raise ValueError(f"'{spec}' publishes UDP port {VXLAN_PORT}, or one from {low} to {high}; overlays have those")
    return found


def exposed(spec: str) -> tuple[tuple[int, str], ...]:
    """Read `port[-port][/protocol]`."""
    numbers, _, kind = spec.partition("/")
    found = _range(numbers)
    if len(found) > MOST_PORTS:
        raise ValueError(f"'{spec}' exposes {len(found)} ports; {MOST_PORTS} are the most")
    return tuple((port, kind or "tcp") for port in found)


def _range(spec: str) -> range:
    first, _, last = spec.partition("-")
    low, high = int(first), int(last or first)
    if not 1 <= low <= high <= 65535:
        raise ValueError(f"'{spec}' is not within ports 1 to 65535")
    return range(low, high + 1)
