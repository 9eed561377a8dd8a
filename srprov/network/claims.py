"""What robots say that an instance has on them, and what each of them says that others have there.

Takes all robots as they are; gives counts and answers. Pure. A robot that an overlay comes to is not bound by what
another one says of it: what it has not got of the instance itself is measured by its own word on what others have.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from ipaddress import IPv4Network
from typing import Any

from srprov.facts.model import Snapshot
from srprov.network.foreign import ForeignUse, Ranges, lifelines, of_robot, to_network


class Claims:
    """The Docker networks of one instance, by robot, and what stands in their way."""

    def __init__(self, instance: str, names: tuple[str, str], snapshot: Snapshot, members: Sequence[str]) -> None:
        """Take the instance, its bridge's and link's names, the robots, and those that its overlay is to be on."""
        self._names, self._snapshot = names, snapshot
        self._states = {robot: _states(instance, snapshot, robot) for robot in snapshot.observed}
        # who gets nothing of the overlay counts only where nobody that does has a network of it
        having = [robot for robot in members if self._states.get(robot)]
        self.made = having or [robot for robot, states in self._states.items() if states]
        """Robots that have a network of it, and whose word counts."""
        self._uses: dict[str, tuple[ForeignUse, ...]] = {
            robot: tuple(of_robot(robot, instance, names, snapshot)) for robot in members
        }
        self._ranges = {robot: Ranges(use.subnet for use in uses) for robot, uses in self._uses.items()}

    def subnets(self) -> Mapping[str, int]:
        """Return each subnet with how many robots have it; a robot counts once, however many networks it tells of."""
        return Counter(text for robot in self.made for text in self._values(robot, "subnet", str))

    def vnis(self) -> Mapping[int, int]:
        """Return each VNI likewise."""
        return Counter(number for robot in self.made for number in self._values(robot, "vni", int))

    def lifelines(self) -> Ranges:
        """Return the addresses that some robot would be lost without."""
        every = self._snapshot.facts.values()
        return Ranges(network for facts in every for network in lifelines(facts, self._names))

    def routed_elsewhere(self, subnet: IPv4Network) -> bool:
        """Return whether a member that does not have a subnet yet has something else there."""
        return any(
            ranges.meet(subnet)
            for robot, ranges in self._ranges.items()
            if subnet not in map(to_network, self._values(robot, "subnet", str))
        )

    def has_vni(self, vni: int, port: int) -> bool:
        """Return whether a member that does not have a VNI yet has it for something else, on the same port."""
        return any(
            use.vni == vni and use.port in (0, port)
            for robot, uses in self._uses.items()
            if vni not in self._values(robot, "vni", int)
            for use in uses
        )

    def _values(self, robot: str, key: str, kind: type) -> set[Any]:
        return {value for state in self._states.get(robot, ()) if isinstance(value := state.get(key), kind)}


def _states(instance: str, snapshot: Snapshot, robot: str) -> list[Mapping[str, Any]]:
    things = snapshot.observed.get(robot, ())
    return [thing.state for thing in things if "subnet" in thing.state and thing.instance == instance]
