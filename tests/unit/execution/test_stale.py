"""What others did on a robot between a plan and its run: nothing of theirs is taken, replaced or removed."""

from __future__ import annotations

import json

import pytest
from msgspec.structs import replace

from srprov.controller.owners import Owner
from srprov.execution import Outcome, RunResult
from srprov.planning.plan import Plan
from tests.fakes import World
from tests.worlds import Experiment, Mount, experiment, plan_for, removal_for, run, service

MAPS = Mount(kind="volume", source="maps", target="/maps")
RECORD = "/var/lib/srprov/hello/placement.json"


def by(who: str, name: str) -> Experiment:
    """Return an experiment of the name that all have here, in somebody's own file; each has a volume `maps`."""
    return replace(experiment(service(name, robot="r1", network="none", mounts=(MAPS,))), file=f"/{who}/hello.edf")


def plan_of(world: World, who: str, name: str) -> Plan:
    owner = Owner(instance="hello", edf=f"/{who}/hello.edf", token=who)
    return plan_for(world, by(who, name), owner=owner)


def outcome(result: RunResult, identity: str) -> tuple[Outcome, str]:
    return next((one.outcome, one.message) for one in result.results if one.step.id == identity)


@pytest.mark.parametrize("name", ["theirs", "mine"])
def test_what_came_since_under_the_same_name_stays_whose_it_is(name: str) -> None:
    """A question may stand for an hour. Another experiment of the name has a volume there by then, and its record."""
    world = World().add("r1", "r2")
    late = plan_of(world, "late", name)
    assert run(world, plan_of(world, "first", "mine")).exit_code == 0
    there = {robot: one.disk.files[RECORD] for robot, one in world.robots.items()}
    result = run(world, late)
    assert outcome(result, "r1/volume:srprov.hello.maps") == (
        Outcome.FAILED,
        "the robot changed since the plan was made: now it is there, and somebody else made it; plan again",
    )
    assert outcome(result, f"r1/container:srprov.hello.{name}")[0] is not Outcome.CHANGED
    for robot, one in world.robots.items():
        assert one.disk.files[RECORD] == there[robot], "it says whose the instance is"
        assert json.loads(one.disk.files[RECORD])["source"] == "lab@desk:/first/hello.edf"
    assert set(world.robots["r1"].engine.containers) == {"srprov.hello.mine"}


def test_what_the_same_experiment_did_meanwhile_is_right() -> None:
    world = World().add("r1", "r2")
    plan = plan_of(world, "first", "mine")
    assert run(world, plan).exit_code == 0
    again = run(world, plan)
    assert {one.outcome for one in again.results} == {Outcome.UNCHANGED}


def test_nothing_is_removed_that_took_the_place_of_what_was_planned_to_go() -> None:
    world = World().add("r1")
    assert run(world, plan_of(world, "late", "mine")).exit_code == 0
    late = removal_for(world, volumes=True)
    assert run(world, late).exit_code == 0
    assert run(world, plan_of(world, "first", "mine")).exit_code == 0
    result = run(world, late)
    assert outcome(result, "r1/container:srprov.hello.mine")[0] is Outcome.FAILED
    assert outcome(result, "r1/volume:srprov.hello.maps")[0] is not Outcome.CHANGED
    assert RECORD in world.robots["r1"].disk.files
    assert world.robots["r1"].engine.volumes
    assert set(world.robots["r1"].engine.containers) == {"srprov.hello.mine"}
