"""A service that is pinned to a robot which nobody knows."""

from __future__ import annotations

from types import MappingProxyType

from srprov.definitions.model import Experiment, Host, Inventory, Service
from srprov.definitions.pins import unknown_pins
from srprov.errors import Location

HOSTS = {name: Host(name=name, address=name) for name in ("arm1", *(f"rover{n}" for n in range(10, 30)))}
INVENTORY = Inventory(hosts=MappingProxyType(HOSTS), groups=MappingProxyType({}))


def problems(**pins: str) -> list[tuple[str, str, str]]:
    services = {name: Service(name=name, robot=pin, location=Location("a.edf", 7, 3)) for name, pin in pins.items()}
    experiment = Experiment(name="x", file="a.edf", folder=".", services=MappingProxyType(services))
    return [(str(one.location), one.path, one.hint) for one in unknown_pins(experiment, INVENTORY)]


def test_a_known_pin_and_no_pin_are_fine() -> None:
    assert problems(a="arm1", b="") == []


def test_each_unknown_pin_is_one_problem_at_its_service() -> None:
    found = problems(a="rovr12", b="arm1", c="xyz")
    assert found[0] == ("a.edf:7:3", "services.a.robot", "did you mean 'rover12'?")
    assert found[1][:2] == ("a.edf:7:3", "services.c.robot")


def test_a_long_inventory_is_not_listed_whole() -> None:
    ((_, _, hint),) = problems(c="xyz")
    assert hint.startswith("it has: arm1, rover10") and hint.endswith("and 9 more")
