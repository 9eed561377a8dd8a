"""What joins an instance that somebody else made since the plan: nothing, whatever its own steps find as planned."""

from __future__ import annotations

from unittest import mock

import pytest
from msgspec.structs import replace

from srprov.controller import plan
from srprov.controller.ownership import makers_of
from srprov.controller.plan import Planned
from srprov.controller.remove import make_removal
from srprov.definitions.model import Definitions, Experiment
from srprov.errors import RefusedError
from srprov.execution import RunResult
from srprov.facts.gather import Detail
from tests.fakes import World
from tests.worlds import AS_IT_IS, QUICK, experiment, fleet, made, remembering_all, run, service

RECORD = "/var/lib/srprov/hello/placement.json"
MINE = experiment(service("web", robot="r1"))
HOSTS = {"r1": {"srprov.hello.web"}, "r2": set[str](), "r3": set[str](), "r4": set[str]()}


def planned_by(world: World, who: str, what: Experiment, *, adopt: bool = False) -> Planned:
    """Return what somebody's file comes to, who has the experiment's name."""
    with mock.patch.object(plan, "source_of", return_value=f"lab@desk:/{who}/hello.edf"):
        return made(world, Definitions(experiment=what, containers={}), replace(AS_IT_IS, adopt=adopt))


def done(world: World, planned: Planned) -> RunResult:
    return run(world, planned.plan, replace(QUICK, makers=planned.makers))


def there(world: World) -> dict[str, set[str]]:
    return {name: set(robot.engine.containers) for name, robot in world.robots.items()}


@pytest.mark.parametrize("robot", ["r1", "r4"])
def test_no_container_of_another_name_joins_what_somebody_else_made_meanwhile(robot: str) -> None:
    """Its hosts file is its own, and the network is as planned. On r4 there is nothing else of that name."""
    world = World().add("r1", "r2", "r3", "r4")
    inside = service("evil", robot=robot, hostname="vault.lab.example", extra_hosts=(("x", "10.1.2.3"),))
    late = planned_by(world, "late", experiment(inside))
    assert done(world, planned_by(world, "first", MINE)).exit_code == 0
    records = {name: one.disk.files.get(RECORD) for name, one in world.robots.items()}
    with pytest.raises(RefusedError, match=r"made from lab@desk:/first/hello\.edf; nothing was done") as refused:
        done(world, late)
    assert refused.value.exit_code == 9
    assert there(world) == HOSTS
    assert {name: one.disk.files.get(RECORD) for name, one in world.robots.items()} == records


def test_a_record_alone_tells_who_made_it() -> None:
    """Of what is on r4, the others that the late one changes keep the record, and nothing else."""
    world = World().add("r1", "r2", "r3", "r4")
    late = planned_by(world, "late", experiment(service("evil", robot="r3", network="none")))
    mine = experiment(service("web", robot="r4", network="none"))
    assert done(world, planned_by(world, "first", mine)).exit_code == 0
    with pytest.raises(RefusedError, match="r1 changed since the plan was made"):
        done(world, late)
    assert not world.robots["r3"].engine.containers


def test_what_was_there_when_it_was_planned_is_taken_over() -> None:
    world = World().add("r1", "r2")
    assert done(world, planned_by(world, "first", MINE)).exit_code == 0
    taken = planned_by(world, "late", experiment(service("web", robot="r1"), service("more", robot="r1")), adopt=True)
    assert done(world, taken).exit_code == 0


def test_what_the_same_experiment_did_meanwhile_ends_nothing() -> None:
    world = World().add("r1", "r2")
    once, again = planned_by(world, "first", MINE), planned_by(world, "first", MINE)
    assert done(world, once).exit_code == 0
    assert done(world, again).exit_code == 0


def test_what_another_experiment_made_meanwhile_is_not_removed() -> None:
    world = World().add("r1")
    assert done(world, planned_by(world, "first", MINE)).exit_code == 0
    with remembering_all(world):
        late, gone = (make_removal(fleet(world), "hello", volumes=False) for _ in range(2))
    assert done(world, gone).exit_code == 0
    assert done(world, planned_by(world, "second", MINE)).exit_code == 0
    with pytest.raises(RefusedError, match="made from lab@desk:/second/hello"):
        done(world, late)
    assert there(world)["r1"] == {"srprov.hello.web"}


def test_a_source_with_quotes_is_read_from_a_record() -> None:
    world = World().add("r1")
    assert done(world, planned_by(world, 'a"b\\', MINE)).exit_code == 0
    late = planned_by(world, "late", MINE, adopt=True)
    with pytest.raises(RefusedError, match=r'made from lab@desk:/a"b\\/hello\.edf'):
        done(world, replace(late, makers=frozenset({late.plan.source})))


def test_makers_are_all_that_robots_tell_of() -> None:
    world = World().add("r1", "r2")
    assert done(world, planned_by(world, "first", MINE)).exit_code == 0
    with remembering_all(world):
        snapshot = fleet(world).gather(Detail.BASIC)
    assert makers_of(snapshot, "hello", "x") == {"x", "lab@desk:/first/hello.edf"}
    assert makers_of(snapshot, "other", "x") == {"x"}


@pytest.mark.parametrize("path", ["/containers/json", "/networks"])
def test_who_does_not_say_who_made_what_is_there_gets_nothing(path: str) -> None:
    world = World().add("r1")
    late = planned_by(world, "late", experiment(service("late", robot="r1")))
    assert done(world, planned_by(world, "first", MINE)).exit_code == 0
    world.robots["r1"].engine.unreadable.add(path)
    with pytest.raises(RefusedError, match=f"r1 does not say who made what is there: .*{path} cannot be read"):
        done(world, late)
    assert there(world)["r1"] == {"srprov.hello.web"}


def test_who_does_not_say_it_in_time_gets_nothing_either() -> None:
    """A late engine is not one that is not there: it runs what somebody else made."""
    world = World().add("r1")
    late = planned_by(world, "late", experiment(service("late", robot="r1")))
    assert done(world, planned_by(world, "first", MINE)).exit_code == 0
    world.robots["r1"].engine.late = True
    with pytest.raises(RefusedError, match=r"r1 does not say who .*: the Docker Engine did not answer within 20 s"):
        done(world, late)


def test_a_robot_whose_containers_cannot_be_read_is_not_said_to_have_none() -> None:
    """`destroy` did nothing there, and said that it was done."""
    world = World().add("r1")
    assert done(world, planned_by(world, "first", MINE)).exit_code == 0
    world.robots["r1"].engine.unreadable.add("/containers/json")
    with remembering_all(world):
        gone = make_removal(fleet(world), "hello", volumes=False)
    assert "/containers/json cannot be read" in gone.plan.unreachable["r1"]
    assert there(world)["r1"] == {"srprov.hello.web"}
