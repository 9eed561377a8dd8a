"""Whom a run asks, when it has changed something of the overlay."""

from __future__ import annotations

from msgspec.structs import replace

from srprov.controller.probe import probing_of
from srprov.definitions.model import Definitions
from tests.fakes import World
from tests.worlds import AS_IT_IS, apply, experiment, made, service

WHAT = experiment(service("a", robot="r1"), service("b", robot="r2"), service("c", robot="r3"))


def test_every_robot_and_service_is_asked() -> None:
    probing = probing_of(made(World().add("r1", "r2", "r3"), Definitions(experiment=WHAT, containers={})))
    assert probing is not None and probing.request.robots == ("r1", "r2", "r3")
    assert {one.service for one in probing.request.endpoints} == {"", "a", "b", "c"}
    assert probing.architectures.keys() == {"r1", "r2", "r3"}


def test_robots_that_limit_leaves_something_to_do_on_are_not_asked() -> None:
    """Nothing of the overlay is there yet; those that had all before are asked with the chosen one."""
    world = World().add("r1", "r2", "r3")
    planned = made(world, Definitions(experiment=WHAT, containers={}))
    alone = probing_of(planned.limited({"r1"}))
    assert alone is not None and alone.request.robots == ("r1",)
    assert {one.service for one in alone.request.endpoints} == {"", "a"}
    assert probing_of(planned.limited(set())) is None

    assert apply(world, WHAT).exit_code == 0
    for robot in ("r1", "r3"):
        world.robots[robot].engine.containers.clear()
    again = made(world, Definitions(experiment=WHAT, containers={}), replace(AS_IT_IS, adopt=True))
    later = probing_of(again.limited({"r1"}))
    assert later is not None and later.request.robots == ("r1", "r2")


def test_what_is_on_no_overlay_is_not_asked() -> None:
    what = experiment(service("a", robot="r1", network="host"))
    assert probing_of(made(World().add("r1"), Definitions(experiment=what, containers={}))) is None
