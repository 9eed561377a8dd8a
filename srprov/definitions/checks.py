"""What a schema cannot say of an EDF: names that must exist, cycles, sums, networks.

Takes the root, the services that could be built, and their containers; adds to `Findings`. Touches nothing but a
Dockerfile whose healthcheck matters.
"""

from __future__ import annotations

import ipaddress
from collections.abc import Mapping

from srprov import names
from srprov.codes import Code
from srprov.definitions import discovery, endless, hostnames, nested, relations, sharing
from srprov.definitions.container import Container
from srprov.definitions.containermodel import HealthCheck
from srprov.definitions.model import Service
from srprov.definitions.service import depends_on
from srprov.definitions.values import scalars, text
from srprov.errors import did_you_mean
from srprov.yamldoc import nodes
from srprov.yamldoc.nodes import Findings, Map, Node, Path, Scalar, Seq

_PRIVATE = tuple(ipaddress.IPv4Network(block) for block in ("10.0.0.0/8", "172.16.0.0/12", "192.168.0.0/16"))
_SMALLEST_PREFIX = 28
_LONGEST_CIRCLE = 12
"""Services that are named of one."""


def service_maps(root: Map) -> dict[str, Map]:
    """Return the services' entries by name, those that are maps at all."""
    services = root.entries.get("services")
    if not isinstance(services, Map):
        return {}
    return {name: entry for name, entry in services.entries.items() if isinstance(entry, Map)}


def service_key(root: Map, name: str) -> Scalar:
    """Return the place where a service's name is written."""
    services = root.entries["services"]
    assert isinstance(services, Map)
    return services.keys[name]


def check(
    root: Map, services: Mapping[str, Service], containers: Mapping[str, Container | None], findings: Findings
) -> None:
    """Add everything that is wrong beyond the schema."""
    known = service_maps(root)
    _reserved(root, known, findings)
    _references(root, known, findings)
    _cycles(known, findings)
    for name, one in services.items():
        _networks(known[name], one, findings)
        endless.check(known[name], one, findings)
        _conditions(known[name], one, services, containers, findings)
    _pins(root, known, findings)
    sharing.check(known, services, findings)
    nested.check(known, services, findings)
    hostnames.check(known, services, findings)
    relations.check(root, known, same_robot_groups(root), sharing.with_shared((), services), findings)
    discovery.check(root, services, findings)
    _weights(root, findings)
    _subnet(root, len(known), findings)


def _reserved(root: Map, known: Mapping[str, Map], findings: Findings) -> None:
    """Check names that the hosts file has for others; what the schema says of a name it has said already."""
    for name in sorted(names.RESERVED & set(known)):
        wrong = names.fault("service", name)
        findings.add(service_key(root, name), wrong, ("services", name), "rename the service", code=Code.NAME)


def _references(root: Map, known: Mapping[str, Map], findings: Findings) -> None:
    """Check every place that names a service."""
    for name, entry in known.items():
        path: Path = ("services", name, "depends_on")
        waits = entry.entries.get("depends_on")
        named = list(waits.keys.values()) if isinstance(waits, Map) else list(scalars(waits))
        for item in named:
            _known(item, known, findings, path)
    lists: list[tuple[Node, Path]] = []
    pools, related = (root.entries.get(key) for key in ("pools", "relations"))
    for index, pool in enumerate(pools.items if isinstance(pools, Seq) else ()):
        if isinstance(pool, Map) and "services" in pool.entries:
            lists.append((pool.entries["services"], ("pools", index, "services")))
    for kind in ("same_robot", "different_robot"):
        groups = related.entries.get(kind) if isinstance(related, Map) else None
        lists += [
            (group, ("relations", kind, i)) for i, group in enumerate(groups.items if isinstance(groups, Seq) else ())
        ]
    network = root.entries.get("network")
    servers = network.entries.get("discovery_servers") if isinstance(network, Map) else None
    for group, path in (*lists, (servers, ("network", "discovery_servers"))):
        for item in scalars(group):
            _known(item, known, findings, path)


def _known(item: Scalar, known: Mapping[str, Map], findings: Findings, path: Path) -> None:
    if item.text not in known and not findings.broken(path):
        hint = did_you_mean(item.text, known) or f"known: {', '.join(sorted(known)[:12])}"
        findings.add(item, f"there is no service '{item.text[:60]}'", path, hint, code=Code.NO_SUCH_NAME)


def _cycles(known: Mapping[str, Map], findings: Findings) -> None:
    """Name each cycle of dependencies once, at the dependency that closes it."""
    waits = {name: sorted(depends_on(entry.entries.get("depends_on"))) for name, entry in known.items()}
    done: set[str] = set()
    for start in sorted(waits):
        stack = [(start, iter(waits[start]))] if start not in done else []
        trail = dict.fromkeys(name for name, _ in stack)
        while stack:
            name, rest = stack[-1]
            following = next((other for other in rest if other in waits), None)
            if following is None:
                done.add(name)
                stack.pop()
                del trail[name]
            elif following in trail:
                names = list(trail)
                circle = [*names[names.index(following) :], following]
                if len(circle) > _LONGEST_CIRCLE:
                    circle = [*circle[:_LONGEST_CIRCLE], "...", following]
                place = _dependency(known[name], following)
                message = f"the services wait for each other: {' -> '.join(circle)}"
                findings.add(place, message, ("services", name, "depends_on"), code=Code.DEPENDENCY)
            elif following not in done:
                stack.append((following, iter(waits[following])))
                trail[following] = None


def _dependency(entry: Map, name: str) -> Node:
    """Return the place where an entry names a service that it waits for."""
    waits = entry.entries.get("depends_on", entry)
    if isinstance(waits, Map):
        return nodes.key_or_value(waits, name)
    return next((item for item in scalars(waits) if item.text == name), waits)


def _networks(entry: Map, one: Service, findings: Findings) -> None:
    if one.runtime.ports and one.network in ("none", "host", "both"):
        why = "has no network to publish from" if one.network == "none" else "is on the robot's network already"
        place = nodes.key_or_value(entry, "ports" if "ports" in entry.entries else "network")
        message = f"ports are published, but a service with 'network: {one.network}' {why}"
        hint = "" if one.network == "none" else "declare them with 'expose'"
        findings.add(place, message, ("services", one.name, "ports"), hint, code=Code.EXCLUSIVE)


def _conditions(
    entry: Map,
    one: Service,
    services: Mapping[str, Service],
    containers: Mapping[str, Container | None],
    findings: Findings,
) -> None:
    for other, wanted in one.depends_on.items():
        target, path = services.get(other), ("services", one.name, "depends_on", other)
        if target is None or not (target.image or ((cdf := containers[other]) and cdf.whole)):
            continue  # what is wrong with it is told elsewhere, or is not known yet
        place = nodes.find(entry, ("depends_on", other, "condition"))
        if wanted == "healthy" and not _known_healthcheck(containers[other], target.runtime.healthcheck):
            where = "in the EDF" if target.image else "in the EDF or the CDF"
            message = f"waits for '{other}' to be healthy, but it has no healthcheck"
            hint = f"add one to '{other}' {where}, or wait for started"
            findings.add(place, message, path, hint, code=Code.DEPENDENCY)
        if wanted == "completed" and target.runtime.restart in ("always", "unless-stopped"):
            message = f"waits for '{other}' to complete, but its 'restart: {target.runtime.restart}' never lets it end"
            findings.add(place, message, path, code=Code.DEPENDENCY)


def _known_healthcheck(container: Container | None, merged: HealthCheck | None) -> bool:
    """Return whether a service surely has a healthcheck: its own, its CDF's, or that of a Dockerfile."""
    if merged is not None:
        return merged.test != ("NONE",)
    return container is not None and container.image_has_healthcheck


def same_robot_groups(root: Map) -> tuple[tuple[str, ...], ...]:
    """Return the groups that must share a robot; groups with a common service are one."""
    related = root.entries.get("relations")
    given = related.entries.get("same_robot") if isinstance(related, Map) else None
    group_of: dict[str, set[str]] = {}
    for item in given.items if isinstance(given, Seq) else ():
        group = {name.text for name in scalars(item)}
        for touching in [group_of[name] for name in group if name in group_of]:
            group |= touching
        group_of.update(dict.fromkeys(group, group))
    return tuple(sorted({tuple(sorted(group)) for group in group_of.values()}))


def _pins(root: Map, known: Mapping[str, Map], findings: Findings) -> None:
    for group in same_robot_groups(root):
        pins = [
            (name, known[name].entries["robot"]) for name in group if name in known and "robot" in known[name].entries
        ]
        for name, pin in pins[1:]:
            first = pins[0]
            if text(pin) != text(first[1]):
                message = (
                    f"'{name}' is on '{text(pin)}', but same_robot puts it with '{first[0]}' on '{text(first[1])}'"
                )
                findings.add(pin, message, ("services", name, "robot"), code=Code.NAME)


def _weights(root: Map, findings: Findings) -> None:
    weights = root.entries.get("weights")
    if not isinstance(weights, Map) or findings.broken(("weights",)):
        return
    given = {key: value for key, value in weights.entries.items() if not key.startswith("x-")}
    if "vram" in given and "memory" in given:
        message = "'memory' and 'vram' are the same weight; give one"
        findings.add(weights.keys["vram"], message, ("weights", "vram"), code=Code.EXCLUSIVE)
        return
    total = sum(nodes.as_number(value) or 0.0 for value in given.values()) + 0.25 * (4 - len(given))
    if abs(total - 1) > 1e-6:
        left = "; those not given are 0.25" if len(given) < 4 else ""
        message = f"the weights sum to {total:g}, not 1{left}"
        findings.add(root.keys["weights"], message, ("weights",), code=Code.WRONG_VALUE)


def _subnet(root: Map, services: int, findings: Findings) -> None:
    network = root.entries.get("network")
    given = network.entries.get("subnet") if isinstance(network, Map) else None
    path = ("network", "subnet")
    if not isinstance(given, Scalar) or findings.broken(path):
        return
    try:
        subnet = ipaddress.IPv4Network(given.text)
    except ValueError:
        wrong = f"'{given.text[:60]}' is not an IPv4 network"
        findings.add(given, wrong, path, _network_hint(given.text), code=Code.OVERLAY)
        return
    if not any(subnet.subnet_of(block) for block in _PRIVATE):
        wrong, hint = f"'{given.text}' is not a private network", "use one within 10/8, 172.16/12 or 192.168/16"
        findings.add(given, wrong, path, hint, code=Code.OVERLAY)
    elif subnet.prefixlen > _SMALLEST_PREFIX:
        hint = f"/{_SMALLEST_PREFIX} is the smallest, /24 is usual"
        findings.add(given, f"'{given.text}' is too small", path, hint, code=Code.OVERLAY)
    elif services + 1 > subnet.num_addresses - 2:  # each robot's bridge has an address of its own, at least one
        message = (
            f"'{given.text}' has {subnet.num_addresses - 2} addresses; {services} services and the robots need more"
        )
        findings.add(given, message, path, code=Code.OVERLAY)


def _network_hint(words: str) -> str:
    try:
        return f"did you mean '{ipaddress.IPv4Network(words, strict=False)}'?"
    except ValueError:
        return "for example 10.200.0.0/24"
