"""Why pairs fail: each failed pair gets the first cause that what was measured and looked at shows. Pure.

Causes that are seen on a robot come first (a link that is down, a wrong entry, a rule that dropped), then those that
only the pattern of what failed tells (the underlay, UDP's port, the MTU, TCP or multicast alone).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import msgspec

from srprov.names import few
from srprov.probing.evidence import Evidence
from srprov.probing.model import UNDERLAY
from srprov.probing.pairs import MTU, MULTICAST, REACH, TCP, Pair

FLOOD = "00:00:00:00:00:00"
APPLY = "`srprov apply` mends it"


class Cause(msgspec.Struct, frozen=True, kw_only=True):
    """Why some pairs fail."""

    kind: str
    """`interface`, `address`, `firewall`, `arp`, `fdb`, `nat`, `underlay`, `port`, `mtu`, `checksum`, `multicast` or
    `unknown`."""
    text: str
    hint: str
    pairs: tuple[Pair, ...] = ()


Judge = Callable[[Evidence, Sequence[Pair]], Iterable[Cause]]
"""Takes failed pairs that have no cause yet; gives causes with the pairs that they explain."""


def judged(evidence: Evidence, judges: Sequence[Judge]) -> tuple[Cause, ...]:
    """Return a cause for every failed pair, in the order of the judges."""
    left = [one for one in evidence.pairs if one.failed and one.source.kind != UNDERLAY]
    causes: list[Cause] = []
    for judge in judges:
        for cause in judge(evidence, tuple(left)):
            causes.append(cause)
        explained = {one.names for cause in causes for one in cause.pairs}
        left = [one for one in left if one.names not in explained]
    return tuple(causes)


def cause_json(cause: Cause) -> dict[str, Any]:
    """Return a cause as the schema describes it."""
    ends = [end for one in cause.pairs for end in (one.source, one.target)]
    return {
        "cause": cause.kind,
        "text": cause.text,
        "hint": cause.hint,
        "robots": sorted({one.robot for one in ends}),
        "services": sorted({one.service for one in ends if one.service}),
        "pairs": [list(one.names) for one in cause.pairs],
    }


def by_robots(pairs: Iterable[Pair]) -> Iterator[tuple[str, str, tuple[Pair, ...]]]:
    """Yield two robots, in name order, with the failed pairs between them in both directions."""
    groups: dict[tuple[str, str], list[Pair]] = {}
    for one in pairs:
        first, second = sorted((one.source.robot, one.target.robot))
        groups.setdefault((first, second), []).append(one)
    for (first, second), some in sorted(groups.items()):
        yield first, second, tuple(some)


def services_of(pairs: Iterable[Pair]) -> str:
    """Return the services of pairs in words, for the end of a sentence."""
    names = sorted({end.service for one in pairs for end in (one.source, one.target) if end.service})
    return f" (services: {few(names, 8)})" if names else ""


def on_underlay(evidence: Evidence, left: Sequence[Pair]) -> Iterator[Cause]:
    """Two robots that do not reach each other outside the overlay either, or by other addresses than they have."""
    for first, second, pairs in by_robots(left):
        there, back = evidence.under(first, second), evidence.under(second, first)
        if first == second or there is None or back is None:
            continue
        moved = next((one for one in (there, back) if one.measured.source), None)
        a, b = evidence.vtep(first), evidence.vtep(second)
        if moved and any(REACH in one.failed for one in pairs):
            asker, other = moved.source.robot, moved.target.robot
            yield Cause(
                kind="nat",
                text=f"{first} - {second}: packets of {other} come to {asker} from {moved.measured.source}, not from "
                f"{evidence.vtep(other)}: there is NAT between them{services_of(pairs)}",
                hint="take addresses that robots reach each other by without NAT (srprov_underlay in the inventory)",
                pairs=pairs,
            )
        elif REACH in there.failed and REACH in back.failed:
            way = _way(first, second, there.heard, back.heard)
            yield Cause(
                kind="underlay",
                text=f"{first} - {second}: the underlay is blocked {way}: {a} and {b} do not ping each other outside "
                f"the overlay either{services_of(pairs)}",
                hint=f"try `ping {b}` on {first}: cables, Wi-Fi isolation of clients, VLANs, routes, firewalls between",
                pairs=pairs,
            )


def _way(first: str, second: str, there: bool | None, back: bool | None) -> str:
    """Say in which direction packets are lost; `there` tells whether the second heard the first."""
    if there and not back:
        return f"from {second} to {first}"
    if back and not there:
        return f"from {first} to {second}"
    return "in both directions"


def of_narrow_links(evidence: Evidence, left: Sequence[Pair]) -> Iterator[Cause]:
    """Small packets come through, and a robot has a link with too small an MTU for the others."""
    narrow = [one for one in left if MTU in one.failed]
    for robot, text in sorted(_narrow_links(evidence).items()):
        pairs = tuple(one for one in narrow if robot in (one.source.robot, one.target.robot))
        if pairs:
            narrow = [one for one in narrow if robot not in (one.source.robot, one.target.robot)]
            hint = f"set it back, or give the overlay a smaller one (network.mtu); {APPLY} where the link is srprov's"
            yield Cause(kind="mtu", text=f"{robot}: {text}{_lost_above(pairs)}", hint=hint, pairs=pairs)


def of_size(evidence: Evidence, left: Sequence[Pair]) -> Iterator[Cause]:
    """Small packets come through, and those of the MTU do not."""
    narrow = [one for one in left if MTU in one.failed]
    request = evidence.found.request
    for first, second, pairs in by_robots(narrow):
        under = [one for one in (evidence.under(first, second), evidence.under(second, first)) if one and one.failed]
        least = min((one.measured.fits for one in under if one.measured.fits), default=0)
        where = (
            f"the underlay carries at most {least} bytes, and {request.underlay_mtu} are needed"
            if least
            else ("the MTU is smaller somewhere on the way")
        )
        yield Cause(
            kind="mtu",
            text=f"{first} - {second}: {where}{_lost_above(pairs)}",
            hint="raise the MTU on the way between them, or set a smaller network.mtu in the EDF",
            pairs=pairs,
        )


def _lost_above(pairs: Sequence[Pair]) -> str:
    fits = min(one.measured.fits for one in pairs)
    others = services_of(pairs)
    return f"; packets of more than {fits} bytes are lost{others}" if fits else f"; large packets are lost{others}"


def _narrow_links(evidence: Evidence) -> dict[str, str]:
    """Return robot -> which of its links has too small an MTU."""
    request, found = evidence.found.request, {}
    for robot, look in evidence.looks.items():
        under = look.host.with_address(evidence.vtep(robot))
        for link, least in (
            (look.host.by_name(request.bridge), request.mtu),
            (look.host.by_name(request.link), request.mtu),
            (under, request.underlay_mtu),
        ):
            if link and 0 < link.mtu < least:
                found[robot] = f"the MTU of {link.name} is {link.mtu}, and {least} are needed"
    return found


def of_pattern(evidence: Evidence, left: Sequence[Pair]) -> Iterator[Cause]:
    """What only the pattern tells: which kind of packet is lost, in which direction, while the underlay works."""
    for first, second, pairs in by_robots(left):
        checks = {check for one in pairs for check in one.failed}
        if REACH in checks and first != second and evidence.under(first, second):
            yield _port(evidence, first, second, pairs)
        elif checks == {TCP}:
            yield Cause(
                kind="checksum",
                text=f"{first} - {second}: TCP does not get through, and pings do{services_of(pairs)}",
                hint="a network card that computes checksums wrongly? try `ethtool -K LINK tx-checksum-ip-generic off` "
                "on both; or a firewall that drops TCP alone",
                pairs=pairs,
            )
        elif checks == {MULTICAST}:
            yield Cause(
                kind="multicast",
                text=f"{first} - {second}: multicast does not get through, and all else does{services_of(pairs)}",
                hint=f"{APPLY}, where a bridge filters it (mcast_snooping) or a forwarding entry is missing; else look "
                "for firewalls that drop multicast",
                pairs=pairs,
            )
        else:
            yield Cause(
                kind="unknown",
                text=f"{first} - {second}: {', '.join(sorted(checks))} fails, and no cause was found"
                f"{services_of(pairs)}",
                hint="look at `ip -d link`, `bridge fdb` and the firewall on both; `srprov plan` shows what differs",
                pairs=pairs,
            )


def _port(evidence: Evidence, first: str, second: str, pairs: tuple[Pair, ...]) -> Cause:
    there = any(one.heard for one in pairs if one.source.robot == first)
    back = any(one.heard for one in pairs if one.source.robot == second)
    tunnel, port = evidence.found.request.tunnel_port, evidence.found.request.port
    ends = f"{evidence.vtep(first)} and {evidence.vtep(second)}"
    if tunnel:
        # without answers there is no handshake: of one direction that is blocked, both fail
        way = _way(first, second, there, back) if there or back else "in one direction at least"
        return Cause(
            kind="port",
            text=f"{first} - {second}: WireGuard's packets, to UDP port {tunnel}, do not get through {way}, while the "
            f"underlay works{services_of(pairs)}",
            hint=f"let UDP to port {tunnel} pass between {ends}: firewalls of the robots and of switches or access "
            f"points between; if one has not the other's key, {APPLY}",
            pairs=pairs,
        )
    return Cause(
        kind="port",
        text=f"{first} - {second}: UDP port {port} is blocked {_way(first, second, there, back)}, while the underlay "
        f"works{services_of(pairs)}",
        hint=f"let UDP to port {port} pass between {ends}: firewalls of the robots and of switches or access points "
        "between; network.port takes another one",
        pairs=pairs,
    )
