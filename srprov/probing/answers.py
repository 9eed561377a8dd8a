"""What a robot's program says, read within limits. Pure.

A robot may say anything: it is heard about its own endpoints alone, numbers are cut to what can be, and whatever has
another shape counts as not said.
"""

from __future__ import annotations

from collections.abc import Collection
from ipaddress import ip_address

from srprov.probing.model import Measured, Request, Said
from srprov.untrusted import integer, json_or_none, lines_of, mapping, text

_FIELDS = 15
_MOST_US = 60_000_000


def parse_said(out: str, request: Request, robot: str) -> dict[int, Said]:
    """Return what a robot's endpoints say, by their index; those of which it says nothing are not in it."""
    mine = request.of(robot)
    said: dict[int, Said] = {}
    for line in lines_of(out, len(mine)):
        one = mapping(json_or_none(line))
        at = integer(one.get("self"), default=-1, low=-1)
        if at in mine:
            said.setdefault(at, _said(one.get("failed"), one.get("error"), one.get("peers"), len(request.endpoints)))
    return said


def _said(failed: object, error: object, peers: object, count: int) -> Said:
    rows = peers[:count] if isinstance(peers, list) else []
    return Said(failed=text(failed, length=16), error=_errno(error), peers=dict(_peers(rows, range(count))))


def _peers(rows: list[object], indices: Collection[int]) -> list[tuple[int, Measured]]:
    found = []
    for row in rows:
        if isinstance(row, list) and len(row) == _FIELDS and (at := integer(row[0], default=-1, low=-1)) in indices:
            found.append((at, _measured(row)))
    return found


def _measured(row: list[object]) -> Measured:
    sent, received, *rtt = (integer(one, high=_MOST_US) for one in row[1:6])
    heard, fits, path_mtu, multicast, tcp, tcp_error, error, unreachable = (integer(one) for one in row[6:14])
    return Measured(
        sent=min(sent, 1000),
        received=min(received, sent, 1000),
        rtt_us=(rtt[0], rtt[1], rtt[2]),
        heard=bool(heard),
        fits=min(fits, 65535),
        path_mtu=min(path_mtu, 65535),
        multicast=bool(multicast),
        tcp=bool(tcp),
        tcp_error=_errno(tcp_error),
        error=_errno(error),
        unreachable=min(unreachable, 256),
        source=_address(row[14]),
    )


def _errno(value: object) -> int:
    return integer(value, high=4095)


def _address(value: object) -> str:
    said = text(value, length=45)
    try:
        return "" if "%" in said else str(ip_address(said))
    except ValueError:
        return ""
