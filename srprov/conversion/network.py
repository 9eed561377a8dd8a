"""The network of a Compose service: its mode, `ports`, `extra_hosts`, and the order of starting. Pure."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from srprov.conversion.fields import duration_text
from srprov.conversion.kept import Kept
from srprov.conversion.names_used import on_overlay
from srprov.conversion.project import Project
from srprov.definitions.containermodel import of_links
from srprov.importing.position import Path
from srprov.published import ALIKE, may_be_published_at

_CONDITIONS = {
    "service_started": "started",
    "service_healthy": "healthy",
    "service_completed_successfully": "completed",
}
_Given = Mapping[str, Any]
_LOOPBACK = re.compile(r"(?<![A-Za-z0-9_.-])(localhost|127\.0\.0\.1)(?![A-Za-z0-9_-])")


def network(given: _Given, project: Project, at: Path) -> dict[str, Any]:
    """Return `network`, and say what a network of Compose's had that the overlay has not."""
    mode = str(given.get("network_mode") or "")
    path = (*at, "network_mode")
    if mode in ("host", "none"):
        if mode == "host":
            _loopback(given, project, at)
        return {"network": mode}
    if mode in ("bridge", "default"):
        project.notes.adapted(path, "the experiment's overlay")
    elif mode:
        kind = mode.partition(":")[0][:40]
        project.notes.refused(
            path, f"'network_mode: {mode[:60]}': the network of {'another' if ':' in mode else 'this'} {kind} cannot be"
            " joined", "services on the overlay reach each other by name; 'host' is the robot's own network",
        )  # fmt: skip
    return {}


def _loopback(given: _Given, project: Project, at: Path) -> None:
    """Note what reaches other services by the loopback: on another robot they are not there."""
    for name, value in (given.get("environment") or {}).items():
        if value and _LOOPBACK.search(value):
            words = f"'{name}' names this robot's loopback: services on other robots are not reached by it"
            project.notes.adapted(
                (*at, "environment", name), words, "name the robot, or put both on one: relations.same_robot"
            )


def ports(given: _Given, project: Project, at: Path) -> dict[str, Any]:
    """Return `ports`, or with the robot's own network `expose`."""
    if given.get("network_mode") == "none":
        for index, _ in enumerate(given.get("ports") or ()):
            project.notes.dropped((*at, "ports", index), "a service without a network publishes nothing")
        return {}
    found: list[tuple[str, int, int, str]] = []
    for index, one in enumerate(given.get("ports") or ()):
        path = (*at, "ports", index)
        protocol = str(one.get("protocol") or "tcp")
        if protocol not in ("tcp", "udp"):
            project.notes.refused((*path, "protocol"), f"a port of '{protocol[:20]}' cannot be published")
            continue
        target, written = int(one["target"]), str(one.get("published") or "")
        if not on_overlay(given):
            project.notes.adapted(
                path, "with this network nothing is published; 'expose' says that the robot's port is used"
            )
            for key in one:
                project.notes.exact((*path, key))
        elif not written:
            project.notes.adapted(path, f"the robot's port {target}; Compose would take any that is free")
        elif "-" in written:
            project.notes.adapted((*path, "published"), f"the first of {written}")
        address = str(one.get("host_ip") or "")
        if on_overlay(given) and not may_be_published_at(address):
            if (plain := ALIKE.get(address)) is None:
                project.notes.refused((*path, "host_ip"), f"{address[:60]} is no host's address of IPv4: leave it out")
                continue
            project.notes.adapted((*path, "host_ip"), f"{plain or 'all addresses'}: nothing is published at IPv6 alone")
            address = plain
        port = (address, int(written.partition("-")[0] or target), target, protocol)
        if on_overlay(given) and of_links(port):
            project.notes.refused(path, f"overlays have UDP port {port[1]}: publish another one")
            continue
        found += [port] * (port not in found)
    if not found:
        return {}
    if not on_overlay(given):
        known = [str(port) for port in given.get("expose") or ()] if given.get("network_mode") == "host" else []
        return {"expose": [*known, *(text for text in _joined(found, expose=True) if text not in known)]}
    return {"ports": list(_joined(found))}


def _joined(given: list[tuple[str, int, int, str]], *, expose: bool = False) -> Iterator[str]:
    """Yield ports as text, those that follow each other as ranges."""
    start = 0
    for end in range(1, len(given) + 1):
        address, published, target, protocol = given[start]
        count = end - start
        following = (address, published + count, target + count, protocol)
        if end < len(given) and given[end] == following:
            continue
        inside, outside = (_range(first, count) for first in (target, published))
        kind = "" if protocol == "tcp" else f"/{protocol}"
        where = f"[{address}]:" if ":" in address else f"{address}:" if address else ""
        yield f"{inside}{kind}" if expose else f"{where}{outside}:{inside}{kind}"
        start = end


def _range(first: int, count: int) -> str:
    return f"{first}-{first + count - 1}" if count > 1 else str(first)


def extra_hosts(given: _Given, project: Project, at: Path) -> dict[str, Any]:
    """Return `extra_hosts` but for what the overlay's own hosts file says, or addresses that will not be there."""
    kept = []
    for one in given.get("extra_hosts") or ():
        name, _, address = str(one).partition("=")
        if name in project.making.known:
            why = f"'{name[:60]}' is a service, which is found at its own address"
        elif project.subnets.have(address):
            why = f"'{name[:60]}' is on a network of the file, whose addresses are not those of the overlay"
        else:
            kept.append(str(one))
            continue
        project.notes.dropped((*at, "extra_hosts"), why)
    return {"extra_hosts": kept} if kept else {}


def depends_on(given: _Given, project: Project, at: Path) -> dict[str, Any]:
    """Return `depends_on`, in its short form where nothing but the order counts; links are a part of it."""
    conditions: dict[str, str] = {}
    for link in given.get("links") or ():
        conditions[str(link).partition(":")[0]] = "started"
    for name, one in (given.get("depends_on") or {}).items():
        conditions[name] = _CONDITIONS.get(str(one.get("condition")), "started")
    found = {}
    for name, condition in sorted(conditions.items()):
        if name in project.names:
            found[project.names[name]] = condition
        elif (given.get("depends_on") or {}).get(name, {}).get("required") is False:
            project.notes.say((*at, "depends_on", name), Kept.DROPPED, f"'{name[:60]}' is not wanted")
        else:
            project.notes.refused((*at, "depends_on", name), f"there is no service '{name[:60]}'")
    if not found:
        return {}
    if set(found.values()) == {"started"}:
        return {"depends_on": list(found)}
    return {"depends_on": {name: {"condition": condition} for name, condition in found.items()}}


def healthcheck(given: _Given, project: Project, at: Path) -> dict[str, Any]:
    """Return `healthcheck`; without a test it is that of the image."""
    check = given.get("healthcheck")
    if check is None:
        return {}
    if check.get("disable"):
        return {"healthcheck": {"disable": True}}
    kept = {key: check[key] for key in ("test", "interval", "timeout", "retries", "start_period") if check.get(key)}
    kept |= {key: duration_text(value) for key, value in kept.items() if key in ("interval", "timeout", "start_period")}
    if list(kept.get("test", ())) == ["NONE"]:
        return {"healthcheck": {"disable": True}}
    if "test" not in kept:
        project.notes.adapted((*at, "healthcheck"), "without a test: that of the image")
    return {"healthcheck": kept}
