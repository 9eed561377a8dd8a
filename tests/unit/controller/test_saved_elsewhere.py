"""Plans that somebody else wrote, and that say of a robot which does not answer, or is not asked, what is not so."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any
from unittest import mock

import pytest
from msgspec.structs import replace

from srprov.controller import plan as planning
from srprov.controller.authority import asked, check_file
from srprov.controller.saved import check_plan, kept_plan
from srprov.errors import RefusedError, UsageError
from srprov.network import layout
from srprov.planning.planfile import PlanFile, dump
from srprov.planning.planread import load
from tests.fakes import World
from tests.unit.controller.test_saved import _alone, planned
from tests.worlds import apply, experiment, fleet, run, service

__all__ = ["_alone"]

MINE = experiment(service("one", robot="r1"), service("two", robot="r2"))
ANOTHERS = "10.0.0.4"
"""The underlay address of r4."""


@pytest.fixture
def world() -> World:
    """Return four robots, two of which run an experiment of the user's."""
    world = World().add("r1", "r2", "r3", "r4")
    assert apply(world, MINE).exit_code == 0
    return world


def written(saved: PlanFile) -> PlanFile:
    """Return a plan file as somebody who knows the format writes it."""
    saved = replace(saved, proof="", plan=replace(saved.plan, notes=(), permissions=()))
    saved = replace(saved, plan=replace(saved.plan, permissions=asked(saved)))
    saved = load(dump(saved), "plan.json")
    check_file(saved, "plan.json")
    return saved


def test_no_packets_go_to_another_robots_address_for_one_that_is_away(world: World) -> None:
    """The file said that r1 is where r4 is; r1 does not answer, so nobody contradicts: r4 was sent what is for r1."""
    true = layout._underlays
    with mock.patch.object(layout, "_underlays", lambda *given: {**true(*given), "r1": ANOTHERS}):
        saved = kept_plan(planned(world, MINE))
    prints = {robot: copy.deepcopy(dict(one)) for robot, one in saved.fingerprints.items()}
    prints["r1"]["underlay"]["address"] = ANOTHERS
    saved = written(replace(saved, fingerprints=prints))
    world.robots["r1"].gone = True
    with pytest.raises(RefusedError, match=rf"packets would go to {ANOTHERS} for r1, of which only this file says"):
        check_plan(saved, fleet(world), adopt=True)


@pytest.mark.parametrize("lie", [ANOTHERS, "", "10.0.0.9"])
def test_a_record_has_each_robot_where_the_plan_found_it(world: World, lie: str) -> None:
    """The user's next plan sends there what is for r1, when that does not answer."""
    true = planning.record

    def lying(*args: Any, **more: Any) -> dict[str, Any]:
        said = copy.deepcopy(true(*args, **more))
        said["robots"]["r1"]["vtep"] = lie
        return said

    theirs = experiment(*MINE.services.values(), service("four", robot="r4"))
    with mock.patch.object(planning, "record", lying):
        saved = replace(kept_plan(planned(world, theirs)), proof="")
    assert "playbook" in {one.kind for one in asked(saved)}
    with pytest.raises(UsageError, match="asks for playbook"):
        check_file(replace(saved, plan=replace(saved.plan, permissions=())), "plan.json")


def without(world: World, robot: str, make: Callable[[], PlanFile]) -> PlanFile:
    """Have a plan made where an inventory lacks a robot."""
    away = world.robots.pop(robot)
    saved = make()
    world.robots = {robot: away, **world.robots}
    return saved


@pytest.mark.parametrize("says", ["nothing", "away"])
def test_a_plan_that_is_not_about_a_robot_is_refused_where_that_has_some_of_it(world: World, says: str) -> None:
    """`one` would run on both, and have other data on r2; nothing in the plan said so."""
    moved = experiment(service("one", robot="r2"), service("two", robot="r2"))
    plan = without(world, "r1", lambda: kept_plan(replace(planned(world, moved))))
    unreachable = {"r1": "no answer"} if says == "away" else {}
    saved = written(replace(plan, plan=replace(plan.plan, unreachable=unreachable)))
    with pytest.raises((RefusedError, UsageError), match="r1"):
        check_plan(saved, fleet(world), adopt=True)
    world.robots["r1"].gone = True
    with pytest.raises(RefusedError, match="one on r1, which does not answer or is not asked: it would be on r2, too"):
        check_plan(saved, fleet(world), adopt=True)


def test_a_robot_that_is_away_gets_nothing_where_another_one_has_its_address(world: World) -> None:
    """Whoever has the address by then would be sent what is for its services."""
    world.robots["r1"].gone = True
    world.robots["r4"].kernel.address = "10.0.0.1"
    one = planned(world, MINE)
    assert any("r4 has the address 10.0.0.1 that it had: nothing is sent to it" in note for note in one.plan.notes)
    assert run(world, one.plan).exit_code == 4
    kernel = world.robots["r2"].kernel
    assert "10.0.0.1" not in str(kernel.fdb) and "10.0.0.1" not in str(kernel.filters)
