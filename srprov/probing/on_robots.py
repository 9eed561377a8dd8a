"""Causes that are seen on a robot: links that are down, missing addresses, wrong entries, rules that drop. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from srprov.probing.causes import APPLY, FLOOD, Cause, services_of
from srprov.probing.evidence import Evidence, by_end
from srprov.probing.firewall import Packet, may_match
from srprov.probing.look import Inside, LinkSeen, Look
from srprov.probing.model import UNDERLAY, Endpoint
from srprov.probing.pairs import Pair

_MINE = ("srprov",)


def of_links(evidence: Evidence, left: Sequence[Pair]) -> Iterator[Cause]:
    """A robot's bridge, VXLAN link or WireGuard, or a container's port: not there, down, or forwarding nothing."""
    request = evidence.found.request
    for robot, look in sorted(evidence.looks.items()):
        wrong = _down(look.host.by_name(request.bridge), request.bridge, "", "bridge") or _down(
            look.host.by_name(request.link), request.link, request.bridge, "VXLAN link"
        )
        wrong = wrong or (_tunnel_down(look) if request.tunnel_port else "")
        pairs = tuple(one for one in left if _between(one, robot))
        if wrong and pairs:
            text = f"{robot}: {wrong}: it is cut off from the others{services_of(_at(pairs, robot))}"
            yield Cause(kind="interface", text=text, hint=APPLY, pairs=pairs)
    ends = by_end(left)
    for endpoint in request.endpoints:
        pairs = tuple(ends.get(endpoint.name, ()))
        inside = evidence.namespace(endpoint) if endpoint.container and pairs else None
        if inside and (wrong := _port_down(inside, endpoint, evidence.looks[endpoint.robot], request.bridge)):
            text = f"{endpoint.robot}: {wrong}: {endpoint.service} is cut off from everybody"
            hint = f"`ip link set dev PORT up` there, or `srprov restart` with --service {endpoint.service}"
            yield Cause(kind="interface", text=text, hint=hint, pairs=pairs)


def _between(pair: Pair, robot: str) -> bool:
    return pair.source.robot != pair.target.robot and robot in (pair.source.robot, pair.target.robot)


def _at(pairs: Sequence[Pair], robot: str) -> list[Pair]:
    """Return pairs with the services of one robot alone, for words."""
    return [one for one in pairs if one.source.robot == robot and not one.target.service]


def _down(link: LinkSeen | None, name: str, bridge: str, word: str) -> str:
    if link is None:
        return f"the {word} {name} is not there"
    if not link.up:
        return f"the {word} {name} is down"
    if bridge and link.master != bridge:
        return f"the {word} {name} is not a port of {bridge}"
    if link.port_state and link.port_state != "forwarding":
        return f"the {word} {name} is a port of {link.master} that is {link.port_state}"
    return ""


def _tunnel_down(look: Look) -> str:
    links = [one for one in look.tunnel.links if one.name.startswith("srpw")] if look.tunnel else []
    if not links:
        return "the WireGuard interface, which encrypts the overlay, is not there"
    return "" if any(one.up for one in links) else f"the WireGuard interface {links[0].name} is down"


def _port_down(inside: Inside, endpoint: Endpoint, look: Look, bridge: str) -> str:
    own = inside.with_address(endpoint.address)
    if own is None:
        return f"{endpoint.service} does not have its address {endpoint.address}"
    if not own.up:
        return f"{own.name} of {endpoint.service} is down"
    port = next((one for one in look.host.links if one.index == own.peer), None)
    return _down(port, port.name, bridge, "bridge port") if port else ""


def of_addresses(evidence: Evidence, left: Sequence[Pair]) -> Iterator[Cause]:
    """An endpoint that could not even open a socket at its address."""
    every, ends = evidence.found.request.endpoints, by_end(left)
    for at, said in sorted(evidence.found.said.items()):
        if said.failed and every[at].kind != UNDERLAY:
            one = every[at]
            pairs = tuple(ends.get(one.name, ()))
            text = f"{one.robot}: {one.address} of {one.service or 'the robot'} is not there"
            yield Cause(kind="address", text=text, hint=APPLY, pairs=pairs)


def of_neighbours(evidence: Evidence, left: Sequence[Pair]) -> Iterator[Cause]:
    """An ARP entry with another MAC than the address has."""
    seen: set[tuple[str, str]] = set()
    ends = by_end(left)
    for pair in left:
        for here, there in ((pair.source, pair.target), (pair.target, pair.source)):
            inside, right = evidence.namespace(here), _mac(evidence, there)
            wrong = inside.neighbours.get(there.address, "") if inside else ""
            if not wrong or not right or wrong == right or (here.name, there.name) in seen:
                continue
            seen.add((here.name, there.name))
            yield Cause(
                kind="arp",
                text=f"{here.robot} - {there.robot}: the ARP entry of {there.address} ({there.name}) at {here.name} is "
                f"{wrong}, and should be {right}",
                hint=f"`ip neigh del {there.address} dev LINK` there; who else has this address?",
                pairs=tuple(one for one in ends[here.name] if there.name in one.names),
            )


def _mac(evidence: Evidence, endpoint: Endpoint) -> str:
    """Return the MAC that an endpoint really has, else the one that it was given."""
    inside = evidence.namespace(endpoint)
    link = inside.with_address(endpoint.address) if inside else None
    return link.mac if link else endpoint.mac


def of_entries(evidence: Evidence, left: Sequence[Pair]) -> Iterator[Cause]:
    """A forwarding entry that is missing or leads elsewhere; one that is missing is named also when all gets through.

    Without a service's entry its frames go to every robot, by the entries for all that is not known.
    """
    request, ends = evidence.found.request, by_end(left)
    robots = [one for one in request.robots if evidence.end(one)]
    for robot in robots:
        look = evidence.looks.get(robot)
        if look is None or look.fdb is None or look.host.by_name(request.link) is None:
            continue
        for other in robots:
            vtep = evidence.end(other)
            if other != robot and (FLOOD, vtep) not in look.fdb:
                pairs = tuple(one for one in left if {one.source.robot, one.target.robot} == {robot, other})
                text = (
                    f"{robot} - {other}: the FDB of {robot} has no entry for what goes to everybody at {other} "
                    f"({FLOOD} dst {vtep}): ARP and multicast of {robot} do not get there{services_of(pairs)}"
                )
                yield Cause(kind="fdb", text=text, hint=APPLY, pairs=pairs)
        yield from _service_entries(evidence, robot, look, ends)


def _service_entries(evidence: Evidence, robot: str, look: Look, ends: Mapping[str, Sequence[Pair]]) -> Iterator[Cause]:
    entries = dict(look.fdb or ())
    for one in evidence.found.request.endpoints:
        vtep = evidence.end(one.robot)
        if not one.mac or not one.container or one.robot == robot or not vtep or entries.get(one.mac) == vtep:
            continue
        there = f"leads to {entries[one.mac]}" if one.mac in entries else "is missing"
        pairs = tuple(pair for pair in ends.get(one.name, ()) if robot in (pair.source.robot, pair.target.robot))
        effect = "it is not reached" if pairs else "its frames go to every robot"
        text = f"{robot} - {one.robot}: the FDB entry of {one.name} ({one.mac} dst {vtep}) at {robot} {there}: {effect}"
        yield Cause(kind="fdb", text=text, hint=APPLY, pairs=pairs)


def of_firewalls(evidence: Evidence, left: Sequence[Pair]) -> Iterator[Cause]:
    """A rule that dropped packets during the round, and may have dropped these."""
    explained: set[tuple[str, str]] = set()
    for robot, rules in sorted(evidence.dropped.items()):
        mine = [(one, _packets(evidence, one)) for one in left if robot in (one.source.robot, one.target.robot)]
        for rule in rules:
            pairs = tuple(one for one, packets in mine if one.names not in explained and may_match(rule, packets))
            if not pairs:
                continue
            explained.update(one.names for one in pairs)
            ours = any(word in rule.text for word in _MINE)
            others = sorted({end.robot for one in pairs for end in (one.source, one.target)} - {robot})
            yield Cause(
                kind="firewall",
                text=f"{' - '.join([robot, ', '.join(others)] if others else [robot])}: a firewall rule of {robot} "
                f"drops packets: {rule.text}{services_of(pairs)}",
                hint=APPLY if ours else f"remove the rule on {robot}, or let the overlay pass before it",
                pairs=pairs,
            )


def _packets(evidence: Evidence, pair: Pair) -> list[Packet]:
    """Return what two endpoints send each other, and what of it their robots send over the underlay."""
    request, packets = evidence.found.request, []
    for here, there in ((pair.source, pair.target), (pair.target, pair.source)):
        packets.append(Packet(source=here.address, target=there.address, protocols=("icmp", "tcp", "udp")))
        a, b = evidence.vtep(here.robot), evidence.vtep(there.robot)
        if a and b and a != b:
            packets.append(Packet(source=a, target=b, protocols=("udp",), port=request.tunnel_port or request.port))
    return packets
