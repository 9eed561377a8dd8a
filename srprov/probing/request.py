"""Whom to ask: the endpoints of an instance, by its placement record. Pure."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from ipaddress import IPv4Address, ip_address
from typing import Any

from msgspec.structs import replace

from srprov.network.foreign import to_network
from srprov.network.identity import link_names
from srprov.network.layout import ON_OVERLAY, OVERHEAD
from srprov.network.record import PlacementRecord, read_record
from srprov.network.tunnel import OVERHEAD as ENCRYPTED
from srprov.probing.model import GATEWAY, SERVICE, UNDERLAY, Endpoint, Request
from srprov.untrusted import integer, mapping, string

MOST_PAIRS = 20_000
"""Above it, services are asked with robots and one service of each alone."""
MOST_ENDPOINTS = 1000
"""As many as the program takes; of more services the first ones by name."""


def request_of(instance: str, document: Mapping[str, Any] | None, *, tunnel_port: int = 0) -> Request | None:
    """Return what to probe of an instance by its placement record; None when nothing of it is on an overlay.

    `tunnel_port` is WireGuard's, which the record does not say: it changes with keys; 0: nothing is encrypted.
    """
    record = read_record(document)
    if record is None or document is None:
        return None
    services = [one for name in sorted(record.addresses) if (one := _service(instance, name, document, record))]
    members = sorted({one.robot for one in services})
    gateways = [
        Endpoint(kind=GATEWAY, robot=robot, address=str(record.gateways[robot]))
        for robot in members
        if robot in record.gateways and within(record.gateways[robot], record.subnet)
    ]
    underlays = [
        Endpoint(kind=UNDERLAY, robot=robot, address=record.vteps[robot]) for robot in members if robot in record.vteps
    ]
    if not gateways:
        return None
    room = max(0, MOST_ENDPOINTS - len(gateways) - len(underlays))
    bridge, link = link_names(instance)
    version = ip_address(underlays[0].address).version if underlays else 4
    added = OVERHEAD[4] + ENCRYPTED[version] if tunnel_port else OVERHEAD[version]
    return Request(
        instance=instance,
        bridge=bridge,
        link=link,
        mtu=record.mtu,
        underlay_mtu=record.mtu + added,
        vni=record.vni,
        port=integer(document.get("port"), low=0, high=65535),
        tunnel_port=tunnel_port,
        endpoints=(*gateways, *underlays, *_thinned(services[:room])),
    )


def _service(instance: str, name: str, document: Mapping[str, Any], record: PlacementRecord) -> Endpoint | None:
    mode = string(mapping(mapping(document.get("services")).get(name)).get("network"))
    if mode not in ON_OVERLAY or name not in record.robots or not within(record.addresses[name], record.subnet):
        return None
    return Endpoint(
        kind=SERVICE,
        robot=record.robots[name],
        address=str(record.addresses[name]),
        service=name,
        container=f"srprov.{instance}.{name}" if mode == "overlay" else "",
        mac=record.macs.get(name, ""),
    )


def within(address: IPv4Address, subnet: str) -> bool:
    """Return whether an address is one of a subnet."""
    network = to_network(subnet)
    return network is not None and address in network


def _thinned(services: list[Endpoint]) -> list[Endpoint]:
    """Return the services; when they are too many to ask all pairs, each but the first of a robot is sparse."""
    if len(services) ** 2 <= MOST_PAIRS:
        return services
    first = {one.robot: one.name for one in reversed(services)}
    return [replace(one, sparse=first[one.robot] != one.name) for one in services]


def among(request: Request, robots: Collection[str], services: Collection[str]) -> Request:
    """Return the request with these robots and services alone."""
    kept = [one for one in request.endpoints if one.robot in robots and (not one.service or one.service in services)]
    return replace(request, endpoints=tuple(kept))
