"""Who has which ports of a robot: containers, as the engine says, and programs that listen, as the kernel says.

Gives questions that only read, and reads the answers. Pure; untrusted. Asked only of robots that shall get a service
with ports, beside other questions.
Source: Docker Engine API 1.41, "List containers"; ss(8).
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Sequence
from ipaddress import ip_address

from srprov.facts.model import TakenPort
from srprov.modules.container_names import instance_of
from srprov.untrusted import LIST_LENGTH, integer, lines_of, mappings, string, text
from srprov.wire import AnyQuery, EngineQuery, Query, Reply

QUERIES: tuple[AnyQuery, ...] = (
    Query(command="ss -Hltunp 2>/dev/null; :", in_place=True),
    EngineQuery(path="/containers/json"),
)
_LISTENER = re.compile(
    r"(?P<protocol>tcp|udp)\s+\S+\s+[0-9]+\s+[0-9]+\s+(?P<address>\S{1,64}):(?P<port>[0-9]{1,5})\s+\S+"
    r"(?:\s+users:\(\(\"(?P<by>[^\"]{1,40})\".*)?\s*"
)
_OF_THE_ENGINE = ("docker-proxy", "rootlesskit")
"""They listen for containers, which the engine names."""


def taken_ports(replies: Sequence[Reply]) -> tuple[TakenPort, ...]:
    """Read the replies to `QUERIES`."""
    listening, containers = replies
    published = itertools.islice(_of_containers(containers), 8 * LIST_LENGTH) if containers.ok else ()
    return (*_listeners(listening.out), *published)


def _listeners(out: str) -> Iterator[TakenPort]:
    for line in lines_of(out, 8 * LIST_LENGTH):
        match = _LISTENER.fullmatch(line)
        if match is not None and match["by"] not in _OF_THE_ENGINE:
            by = text(match["by"] or "a program", length=40)
            port = integer(match["port"], low=0, high=65535, default=0)
            yield TakenPort(address=_address(match["address"]), port=port, protocol=match["protocol"], by=by)


def _of_containers(reply: Reply) -> Iterator[TakenPort]:
    for item in mappings(reply.json()):
        names = item.get("Names")
        name = text(names[0], length=80).lstrip("/") if isinstance(names, list) and names else "without a name"
        for port in mappings(item.get("Ports"), most=LIST_LENGTH):
            public = integer(port.get("PublicPort"), low=0, high=65535, default=0)
            if public and (protocol := string(port.get("Type"))) in ("tcp", "udp"):
                yield TakenPort(
                    address=_address(string(port.get("IP"))),
                    port=public,
                    protocol=protocol,
                    by=f"container {name}",
                    instance=instance_of(item),
                )


def _address(said: str) -> str:
    """Return an address as definitions have it; empty for all of the robot's, and for what cannot be read."""
    bare = said.partition("%")[0].strip("[]")
    try:
        address = ip_address(bare)
    except ValueError:
        return ""
    return "" if address.is_unspecified else str(getattr(address, "ipv4_mapped", None) or address)
