"""Names and borders of pods: headless Services, and NetworkPolicies that keep the experiment apart. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from srprov.definitions.model import Service
from srprov.exporting.kubernetes_files import hashed

_API = "networking.k8s.io/v1"
_LONGEST_LABEL = 63


def services_of(services: Mapping[str, Service]) -> Iterator[dict[str, Any]]:
    """Yield a Service without an address of its own for each name by which others know a service.

    It is resolved before the pod is ready, as with srprov, whose names are there from the start.
    """
    for name, selector in sorted(_selectors(services).items()):
        yield {
            "apiVersion": "v1",
            "kind": "Service",
            "metadata": {"name": name},
            "spec": {"clusterIP": "None", "publishNotReadyAddresses": True, "selector": selector},
        }


def _selectors(services: Mapping[str, Service]) -> dict[str, dict[str, str]]:
    """Return name -> labels of the pods that it means."""
    found: dict[str, dict[str, str]] = {}
    known = {name: one for name, one in services.items() if one.network != "none"}
    for name, one in known.items():
        found[name] = {"srprov.service": name}
        if one.runtime.hostname:
            found.setdefault(one.runtime.hostname, {"srprov.service": name})
    for one in known.values():
        if one.instance_of:
            found.setdefault(one.instance_of, {"srprov.of": one.instance_of})
    return found


def policies(services: Mapping[str, Service]) -> Iterator[dict[str, Any]]:
    """Yield what keeps others out, what lets them in by published ports, and what cuts off services without network."""
    inside: list[dict[str, Any]] = [{"from": [{"podSelector": {}}]}]
    # policies add up: what one lets in, another cannot forbid
    networked = {"matchExpressions": [{"key": "srprov.network", "operator": "NotIn", "values": ["none"]}]}
    yield _policy("inside-only", networked, {"policyTypes": ["Ingress"], "ingress": inside})
    for name, one in services.items():
        if one.runtime.ports and one.network not in ("none", "host"):
            ports = [{"protocol": protocol.upper(), "port": port} for _, _, port, protocol in one.runtime.ports]
            chosen = {"matchLabels": {"srprov.service": name}}
            yield _policy(_name(name), chosen, {"policyTypes": ["Ingress"], "ingress": [{"ports": ports}]})
    if any(one.network == "none" for one in services.values()):
        chosen = {"matchLabels": {"srprov.network": "none"}}
        yield _policy("no-network", chosen, {"policyTypes": ["Ingress", "Egress"]})


def _name(service: str) -> str:
    """Return the name of what lets others in to a service, which no other one has: a DNS label."""
    name = f"ports-{service}"
    return name if len(name) <= _LONGEST_LABEL else f"open-{hashed(service)}"


def _policy(name: str, chosen: Mapping[str, Any], rules: Mapping[str, Any]) -> dict[str, Any]:
    spec = {"podSelector": dict(chosen), **rules}
    return {"apiVersion": _API, "kind": "NetworkPolicy", "metadata": {"name": name}, "spec": spec}
