"""Whether a placement record in a plan file is the one of its own plan: robots believe it, line by line. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from srprov.controller.robot_files import is_record_path
from srprov.facts.model import MOST_SERIAL
from srprov.modules.container_params import ContainerParams
from srprov.modules.file import FileParams
from srprov.modules.module import Names, canonical
from srprov.modules.network import NetworkParams
from srprov.network.record import is_address, read_record
from srprov.planning.plan import Plan
from srprov.resource import Resource
from srprov.untrusted import json_or_none, mapping

_OVERLAY = ("subnet", "vni", "mtu", "port")
_LONGEST = 200
"""Characters of what a record says of a robot or service: the name of a robot is the longest."""
_KEYS = {"instance", "source", "robots", "services", "serial", *_OVERLAY}


class PlacementClaim:
    """What a plan's own resources say of its placement."""

    def __init__(
        self, plan: Plan, names: Names, wants: Iterable[Resource], underlays: Mapping[str, str]
    ) -> None:  # fmt: skip
        """Take all that the plan wants, also what is right already, and robot -> its underlay address."""
        self._plan, self._names, self._underlays = plan, names, underlays
        self._networks: dict[str, NetworkParams] = {}
        self._endpoints: dict[str, dict[str, str]] = {}
        self._judged: dict[str, bool] = {}
        for one in wants:
            if isinstance(one.params, NetworkParams):
                self._networks[one.host] = one.params
            elif isinstance(one.params, ContainerParams):
                at = one.params.network
                end = {"ip": at.ip or "", "mac": at.mac or "", "network": at.mode, "robot": one.host}
                self._endpoints[one.params.service] = end

    def is_record(self, content: str) -> bool:
        """Return whether a file is the record of this placement, and says nothing else; robots share one."""
        if content not in self._judged:
            self._judged[content] = self._is_record(content)
        return self._judged[content]

    def _is_record(self, content: str) -> bool:
        value = mapping(json_or_none(content))
        record = read_record(value)
        if record is None or content != canonical(value) + "\n" or value.keys() != _KEYS:
            return False
        overlays = [[getattr(one, key) for key in _OVERLAY] for one in self._networks.values()] or [["", 0, 0, 0]]
        robots, services, assigned = mapping(value["robots"]), mapping(value["services"]), self._plan.assignment
        return (
            (value["instance"], value["source"]) == (self._names.instance, self._names.source)
            and all(one == [value[key] for key in _OVERLAY] for one in overlays)
            and type(value["serial"]) is int
            and 0 < value["serial"] <= MOST_SERIAL
            and record.robots == assigned
            and (set(services), set(robots)) == (set(assigned), set(assigned.values()))
            and all(_is_short(mapping(one)) for one in (*robots.values(), *services.values()))
            and all(self._is_robot(name, mapping(one)) for name, one in robots.items())
            and all(self._is_service(name, mapping(one)) for name, one in services.items())
        )

    def _is_robot(self, name: str, told: Mapping[str, Any]) -> bool:
        # a later plan sends there what is for a robot that is away by then
        if told.keys() != {"gateway", "vtep"} or name not in self._underlays or told["vtep"] != self._underlays[name]:
            return False
        if told["vtep"] and not is_address(told["vtep"]):
            return False
        network = self._networks.get(name)
        # of a robot that is out of reach nothing is known but what the last record said
        unknown = network is None and name in self._plan.unreachable
        return unknown or told["gateway"] == (network.gateway if network else "")

    def _is_service(self, name: str, told: Mapping[str, Any]) -> bool:
        if name in self._endpoints:
            return told == self._endpoints[name]
        return told.keys() == {"ip", "mac", "network", "robot"} and told["robot"] in self._plan.unreachable


def _is_short(told: Mapping[str, Any]) -> bool:
    """Return whether it is no longer than what a record says: what is read of all records of a robot has an end."""
    return all(isinstance(one, str) and len(one) <= _LONGEST for one in told.values())


def misplaced(plan: Plan, wants: Sequence[Resource]) -> Iterator[str]:
    """Say what a plan's placement, which is shown, says otherwise than what it wants."""
    homes = {one.params.service: one.host for one in wants if isinstance(one.params, ContainerParams)}
    for service, robot in sorted(homes.items()):
        if plan.assignment.get(service, robot) != robot:
            yield f"assignment: '{service}' is wanted on {robot}"
    strange = {name: robot for name, robot in plan.assignment.items() if robot not in plan.unreachable}
    for service in sorted(strange.keys() - homes.keys()) if homes and not plan.playbooks else ():
        yield f"assignment: '{service}' is said to run on {strange[service]}, and nothing of it is wanted there"


def unrecorded(wants: Sequence[Resource]) -> Iterator[Resource]:
    """Yield the containers on robots for which no record of the placement is wanted, as srprov's own playbooks do.

    Without it, nobody knows later what a robot has, and what of it a further plan leaves out.
    """
    recorded = {one.host for one in wants if isinstance(one.params, FileParams) and is_record_path(one.name)}
    yield from (one for one in wants if isinstance(one.params, ContainerParams) and one.host not in recorded)
