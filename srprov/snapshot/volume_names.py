"""What the volumes of a snapshot are called: each name is one volume's of one robot.

Takes robots' services; gives them with names of volumes. In an experiment services that name one volume share it, and
those that are on different robots cannot: one of them would be left out. A robot chooses how its volumes are called, so
which of another one's containers that is would be its word; and many robots have a volume `data`. The name that is made
up for a volume without one is nobody else's either. Pure, but for what it remembers. What a volume holds is not
captured, so nothing is lost with its name.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from srprov.snapshot.containers import Service
from srprov.snapshot.notes import Notes


class VolumeNames:
    """The names that were given for the volumes of all robots."""

    def __init__(self) -> None:
        """Have given none."""
        self._given: dict[tuple[str, str], str] = {}
        """Robot and name there -> name in the experiment."""
        self._taken: set[str] = set()

    def named(self, robot: str, short: str, service: Service, there: Mapping[str, str], notes: Notes) -> Service:
        """Return a service whose volumes have names that no other volumes have.

        Args:
            robot: Its robot.
            short: What that is called in names.
            service: It, as its robot has it.
            there: Path in the container -> what the robot calls the volume there.
            notes: Takes which names are others now.
        """
        if not (before := service.fields.get("volumes")):
            return service
        volumes = [self._one(robot, short, one, there) for one in before]
        for old, new in zip(before, volumes, strict=True):
            if old != new:
                words = f"its volume {old['source']} is called {new['source']} here: each name is one volume's"
                notes.adapted(f"container {service.name}", words)
        return dataclasses.replace(service, fields={**service.fields, "volumes": volumes})

    def _one(self, robot: str, short: str, volume: dict[str, Any], there: Mapping[str, str]) -> dict[str, Any]:
        if volume["type"] != "volume":
            return volume
        key = robot, there.get(volume["target"]) or volume["source"]
        if key not in self._given:
            self._given[key] = self._fresh(volume["source"], short)
        return {**volume, "source": self._given[key]}

    def _fresh(self, name: str, short: str) -> str:
        found = name if name not in self._taken else f"{name[:38]}-{short[:18]}"
        begin, number = found, 2
        while found in self._taken:
            found, number = f"{begin[:57]}-{number}", number + 1
        self._taken.add(found)
        return found
