"""Services that run twice, or may: what a plan says of them."""

from __future__ import annotations

from tests.fakes import World
from tests.worlds import apply, experiment, plan_for, run, service


def test_a_plan_that_leaves_a_service_on_a_robot_out_of_reach_says_so() -> None:
    """The old one may still run: when the robot is back there are two of one address, and it is told which is old."""
    w = World().add("r1", "r2", "r3")
    what = experiment(service("a"))
    apply(w, what)
    ((_, old),) = w.running()
    assert plan_for(w, what).notes == ()
    w.robots[old].gone = True
    assert not any("two of it" in note for note in plan_for(w, what).notes)

    moved = plan_for(w, what, reassign_unreachable=True)
    home = moved.assignment["a"]
    (note,) = (note for note in moved.notes if "two of it" in note)
    assert note.startswith(f"a may still run on {old}, which cannot be reached: then there are two of it")
    assert f"the other on {home}" in note
    assert run(w, moved).exit_code == 4

    w.robots[old].gone = False
    healed = plan_for(w, what)
    (note,) = (note for note in healed.notes if "one address" in note)
    assert note.startswith("a runs on ") and old in note
    assert f"the placement record that is believed names {home}" in note
    assert healed.assignment == {"a": home}, "the one that other robots reach stays"
    removed = [step for step in healed.steps if step.module == "container"]
    assert [(step.host, step.want) for step in removed] == [(old, None)]
    assert run(w, healed).exit_code == 0
    assert w.running() == [("a", home)]
    assert plan_for(w, what).notes == ()
