"""Replicas, `per_robot` and pools from the definitions to the robots, on robots in memory."""

from __future__ import annotations

from msgspec.structs import replace

from srprov.definitions.model import Pool
from tests.fakes import World
from tests.worlds import apply, experiment, plan_for, service


def test_every_instance_runs_once_and_a_second_plan_is_empty() -> None:
    """Two replicas, one instance on each robot, a pool in one slot; what waits for the name waits for all instances."""
    world = World().add("r1", "r2")
    what = experiment(
        replace(service("cam"), per_robot=()),
        replace(service("w"), replicas=2),
        service("late", depends_on={"cam": "started", "w": "started"}),
        slots=2,
        different_robot=(("w",),),
        pools=(Pool(name="p", services=("late", "w"), discount=0.5),),
    )
    made = plan_for(world, what)
    assert {name: made.assignment[name] for name in ("cam-r1", "cam-r2")} == {"cam-r1": "r1", "cam-r2": "r2"}
    assert {made.assignment["w-1"], made.assignment["w-2"]} == {"r1", "r2"}
    late = next(step for step in made.steps if step.name.endswith(".late"))
    assert late.want is not None
    waits = {need.id.rsplit(".", 1)[1] for need in late.want.needs if "/container:" in need.id}
    assert waits == {"cam-r1", "cam-r2", "w-1", "w-2"}
    apply(world, what)
    assert plan_for(world, what).empty


def test_what_runs_on_no_robot_is_in_the_notes() -> None:
    """No robot has the tag, so there is nothing to do, and the plan says why."""
    made = plan_for(World().add("r1"), experiment(replace(service("cam"), per_robot=("lidar",)), service("a")))
    assert "no robot has the tag 'lidar', so 'cam' runs nowhere" in made.notes
