"""How services find each other in Compose: networks, names and addresses. Pure.

Where all services with a network are on one machine they are on the network that Compose makes, whose DNS knows them.
Compose has no network across machines: there, services of the overlay get their robot's own network, and names in their
hosts files. What `network.discovery` gives to containers is made by the same code as for robots.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import msgspec
from msgspec.structs import replace

from srprov.codes import Code
from srprov.definitions.model import Experiment, Service
from srprov.errors import UsageError
from srprov.exporting.model import Machine, Remark
from srprov.exporting.reach_remarks import clashes, on_one_machine, on_several_machines
from srprov.facts.model import Snapshot
from srprov.network.addresses import allocate
from srprov.network.identity import identify
from srprov.network.layout import ON_OVERLAY
from srprov.network.model import Overlay

_MODES = {"overlay": "bridge", "host": "host", "both": "host", "none": "none"}
"""Network of the EDF -> what it is on one machine."""
_BY_ADDRESS = ("static-peers", "discovery-server", "ros1")
"""Kinds of discovery for which containers are told addresses."""
_ITSELF = "127.0.0.1"


class Reach(msgspec.Struct, frozen=True, kw_only=True):
    """The network of one machine's file."""

    modes: Mapping[str, str]
    """Service -> `bridge` (the network that Compose makes), `host` or `none`."""
    overlay: Overlay
    """Who has which name and address, as far as it is known here."""
    network: Mapping[str, Any] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """What is said of the network that Compose makes; empty: nothing."""
    gateway: str = ""
    """The machine's address on that network, where it is fixed."""
    remarks: tuple[Remark, ...] = ()

    def service(self, service: Service, experiment: Experiment) -> dict[str, Any]:
        """Return the keys of a service that say where it is and whom it knows."""
        mode = self.modes[service.name]
        known = (*self._names(service, experiment), *service.runtime.extra_hosts)
        hosts = list(dict.fromkeys(f"{name}={address}" for name, address in known))  # Compose refuses one twice
        found: dict[str, Any] = {} if mode == "bridge" else {"network_mode": mode}
        if mode != "host":  # which the engine refuses
            found["hostname"] = service.runtime.hostname or service.name
        if mode == "bridge":
            also = [service.runtime.hostname, service.instance_of]
            aliases = sorted({name for name in also if name and name != service.name})
            fixed = {"ipv4_address": self.overlay.addresses[service.name]} if self.network else {}
            place = {**({"aliases": aliases} if aliases else {}), **fixed}
            found |= {"networks": {"default": place}} if place else {}
        return {**found, **({"extra_hosts": hosts} if hosts else {})}

    def _names(self, service: Service, experiment: Experiment) -> Iterator[tuple[str, str]]:
        """Yield the names that DNS does not tell this service, with their addresses."""
        mode = self.modes[service.name]
        if mode == "none":
            return
        for name, address in sorted(self.overlay.names.items()):
            # Compose's DNS knows the services of its own network
            if mode == "bridge" and self.modes.get(name) == "bridge":
                continue
            one = experiment.services[name]
            for known in (name, one.runtime.hostname, one.instance_of):
                if known:
                    yield known, address


def reaches(experiment: Experiment, machines: Sequence[Machine], robots: Mapping[str, str]) -> dict[str, Reach]:
    """Return robot -> how its services find others.

    Args:
        experiment: With every instance as a service of its own.
        machines: Who runs what.
        robots: Robot -> the address that other robots reach.

    Raises:
        UsageError: The subnet cannot be, or services are on several robots, and an address of one is not known.
    """
    if _is_across(experiment, {name: one.robot for one in machines for name in one.services}):
        return _across(experiment, machines, robots)
    return {machine.robot: _alone(experiment, machine) for machine in machines}


def as_written(experiment: Experiment, placed: Mapping[str, str]) -> Experiment:
    """Return an experiment whose services have the network that they get in Compose's files; service -> robot."""
    if not _is_across(experiment, placed):
        return experiment
    services = {
        name: replace(one, network="host") if one.network in ON_OVERLAY else one
        for name, one in experiment.services.items()
    }
    return replace(experiment, services=services)


def _is_across(experiment: Experiment, placed: Mapping[str, str]) -> bool:
    """Return whether services that have a network are on several robots, between which Compose has none."""
    return len({robot for name, robot in placed.items() if experiment.services[name].network != "none"}) > 1


def _alone(experiment: Experiment, machine: Machine) -> Reach:
    """Return the network of a machine whose services know no other machine."""
    services = [experiment.services[name] for name in machine.services]
    modes = {one.name: _MODES[one.network] for one in services}
    bridged = [name for name, mode in modes.items() if mode == "bridge"]
    shared = [name for name, mode in modes.items() if mode == "host"]
    settings = experiment.network
    told = settings.discovery in _BY_ADDRESS and any(one.network in ON_OVERLAY for one in services)
    overlay = Overlay(instance=experiment.name, underlays={}, names=dict.fromkeys(shared, _ITSELF))
    if not bridged or not (shared or told or settings.subnet):
        names = {**overlay.names, **dict.fromkeys(bridged, "")}
        addresses = {one.name: _ITSELF for one in services if one.network == "both"}
        overlay = replace(overlay, names=names, addresses={**addresses, **dict.fromkeys(bridged, "")})
        return Reach(modes=modes, overlay=overlay, remarks=tuple(on_one_machine(experiment, services)))
    subnet = identify(experiment.name, settings, Snapshot(facts={}, observed={})).subnet
    given = allocate(experiment.name, subnet, bridged, [machine.robot])
    gateway = given.gateways[machine.robot]
    both = {one.name: gateway for one in services if one.network == "both"}
    addresses = {**given.services, **both}
    names = {**given.services, **dict.fromkeys(shared, gateway)}
    return Reach(
        modes=modes,
        overlay=replace(overlay, names=names, addresses=addresses, aliases=_aliases(services, names)),
        network={"ipam": {"config": [{"subnet": str(subnet), "gateway": gateway}]}},
        gateway=gateway,
        remarks=tuple(on_one_machine(experiment, services)),
    )


def _across(experiment: Experiment, machines: Sequence[Machine], robots: Mapping[str, str]) -> dict[str, Reach]:
    """Return the networks of machines whose services know each other."""
    services = {name: experiment.services[name] for machine in machines for name in machine.services}
    names: dict[str, str] = {}
    for machine in machines:
        for name in machine.services:
            if services[name].network != "none":
                if not robots.get(machine.robot):
                    hint = "services on several robots are told where the others are: give -i INVENTORY that has it"
                    raise UsageError(f"the address of {machine.robot} is not known", hint=hint, code=Code.UNDERLAY)
                names[name] = robots[machine.robot]
    addresses = {name: address for name, address in names.items() if services[name].network in ON_OVERLAY}
    overlay = Overlay(
        instance=experiment.name, underlays=robots, names=names, addresses=addresses,
        aliases=_aliases(services.values(), names),
    )  # fmt: skip
    remarks = tuple(on_several_machines(experiment, list(services.values())))
    return {
        machine.robot: Reach(
            modes={name: "none" if services[name].network == "none" else "host" for name in machine.services},
            overlay=overlay,
            remarks=(*remarks, *clashes(experiment, machine)),
        )
        for machine in machines
    }


def _aliases(services: Iterable[Service], names: Mapping[str, str]) -> dict[str, tuple[str, ...]]:
    """Return the name in the EDF of what runs several times -> the addresses of all its instances."""
    found: dict[str, list[str]] = {}
    for one in services:
        if one.instance_of and one.name in names:
            found.setdefault(one.instance_of, []).append(names[one.name])
    return {name: tuple(dict.fromkeys(some)) for name, some in sorted(found.items())}
