"""`8000-8002:80/udp` -> ports in their long form, by Compose's rules. Pure."""

from __future__ import annotations

import ipaddress
import re
from typing import Any

from srprov.importing.compose.values import Value, refuse
from srprov.importing.position import Path

_RANGE = re.compile(r"([0-9]{1,10})(?:-([0-9]{1,10}))?", re.ASCII)
_MOST = 65_535
_PROTOCOLS = ("tcp", "udp", "sctp")


def parse(value: Value, text: str, path: Path) -> list[dict[str, Any]]:
    """Return the long forms of a short one, one for each port of the container.

    Raises:
        Refused: It is no port.
    """
    host, published, target, protocol = _parts(text)
    if not target:
        raise refuse(value, f"'{text[:100]}' names no port of the container", path)
    if protocol not in _PROTOCOLS:
        raise refuse(value, f"'{protocol[:40]}' is no protocol of ports", path, f"known: {', '.join(_PROTOCOLS)}")
    if host.startswith("[") and host.endswith("]"):
        host = host[1:-1]
    if host and not is_address(host):
        raise refuse(value, f"'{host[:100]}' is no IP address", path)
    first, last = _range(value, target, path)
    if not published:
        return [_port(host, number, "", protocol) for number in range(first, last + 1)]
    begin, end = _range(value, published, path)
    if end - begin == last - first:
        pairs = [(number, str(begin + number - first)) for number in range(first, last + 1)]
    elif first == last:
        pairs = [(first, f"{begin}-{end}")]
    else:
        raise refuse(value, f"the ranges {published} and {target} are not equally long", path)
    # Compose puts the ports of one range in the order of their text
    return [_port(host, *pair, protocol) for pair in sorted(pairs, key=lambda pair: f"{pair[0]}/{protocol}")]


def is_address(text: str) -> bool:
    """Return whether this is an IP address."""
    try:
        ipaddress.ip_address(text)
    except ValueError:
        return False
    return "%" not in text


def _parts(text: str) -> tuple[str, str, str, str]:
    *before, target = text.split(":")
    published = before.pop() if before else ""
    port, _, protocol = target.partition("/")
    return ":".join(before), published, port, protocol.partition("/")[0].lower() or "tcp"


def _range(value: Value, text: str, path: Path) -> tuple[int, int]:
    found = _RANGE.fullmatch(text)
    first = int(found[1]) if found else _MOST + 1
    last = int(found[2] or first) if found else 0
    if not 0 <= first <= last <= _MOST:
        raise refuse(value, f"'{text[:100]}' is no port or range of ports", path)
    return first, last


def _port(host: str, target: int, published: str, protocol: str) -> dict[str, Any]:
    port: dict[str, Any] = {"mode": "ingress", "protocol": protocol}
    port |= {"target": target} if target else {}  # none is none to Compose
    return port | ({"host_ip": host} if host else {}) | ({"published": published} if published else {})
