"""At which of a robot's addresses a port is published. Pure.

Of a number that is published at IPv6 alone another program has the same at IPv4, then or later: the kernel keeps the
two apart. A registry, or an engine, often listens at 127.0.0.1, and who asks `localhost` is answered at `::1` first: by
a container, which the robot takes for itself. Of one host's address of IPv4, and of all, a number is one program's
alone. At a group's an engine listens as at all, beside whoever has the number there, and takes what that one is sent:
Docker's proxy does, of UDP, as Go's `net.ListenUDP` has the address used again for a group.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

_Port = tuple[str, int, int, str]
"""As in `containermodel`: address, published port, container port, protocol."""
_IPV4 = re.compile(r"[0-9]{1,3}(\.[0-9]{1,3}){3}")
_ALL = ("", "0.0.0.0")  # noqa: S104 - compared with, never bound to
_GROUPS, _BYTE = 224, 255
"""From 224.0.0.0 on there are groups, then addresses of no host; so are those that begin with 0."""
ALIKE = {"::": "", "::1": "127.0.0.1"}
"""Address of IPv6 -> what is said in its place, of a container that was made otherwise."""


def may_be_published_at(address: str) -> bool:
    """Return whether it is one host's address of IPv4, or empty: all of the robot's, those of IPv6 too."""
    if address in _ALL:
        return True
    parts = [int(one) for one in address.split(".")] if _IPV4.fullmatch(address) else [0]
    return 0 < parts[0] < _GROUPS and max(parts) <= _BYTE


def ranges(ports: Iterable[_Port]) -> Iterator[str]:
    """Yield published ports as an EDF writes them, neighbours as one range: `127.0.0.1:9000-9010:9000-9010/udp`."""
    first: _Port | None = None
    count = 0
    for port in (*ports, None):
        if first and port == (first[0], first[1] + count, first[2] + count, first[3]):
            count += 1
            continue
        if first:
            at, out, into, kind = first
            last = (f"-{out + count - 1}", f"-{into + count - 1}") if count > 1 else ("", "")
            yield f"{at and at + ':'}{out}{last[0]}:{into}{last[1]}/{kind}"
        first, count = port, 1
