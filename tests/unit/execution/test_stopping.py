"""Containers of one robot stop side by side, as far as nothing has to come before."""

from __future__ import annotations

import threading

import pytest

from srprov.execution import Outcome, RunOptions, run_plan
from srprov.planning.plan import Plan
from srprov.wire import EngineCall, Run
from tests.fakes import World
from tests.worlds import QUICK, apply, experiment, plan_for, removal_for, run, service

SLOW = {"stop_grace_s": 20.0}


def stops(world: World) -> list[str]:
    """Return the scripts that stop containers."""
    return [
        one.what.script
        for one in world.log
        if one.kind == "command" and isinstance(one.what, Run) and one.what.script.startswith("docker stop")
    ]


def up(**fields: object) -> World:
    """Return a robot that runs `a`, `b` and `c`."""
    world = World().add("r1")
    assert apply(world, experiment(*(service(name, **fields) for name in "abc"))).exit_code == 0
    world.log.clear()
    return world


def changed(world: World, **of_b: object) -> Plan:
    """Plan new commands for all three; `b` may say more."""
    services = [service(name, command=("x",), **(of_b if name == "b" else {})) for name in "abc"]
    return plan_for(world, experiment(*services))


def test_all_that_is_removed_is_stopped_by_one_script() -> None:
    """Before the first of them is removed; each with its own grace, none with more than the run allows."""
    world = World().add("r1")
    services = [service("a", **SLOW), service("b"), service("c", stop_grace_s=3.0)]
    assert apply(world, experiment(*services)).exit_code == 0
    world.log.clear()
    assert run(world, removal_for(world), RunOptions(settle_s=0, stop_timeout_s=10)).exit_code == 0
    assert stops(world) == [
        "docker stop -t 10 -- srprov.hello.a srprov.hello.b >/dev/null 2>&1 </dev/null & "
        "docker stop -t 3 -- srprov.hello.c >/dev/null 2>&1 </dev/null & wait"
    ]
    calls = [one.what.method for one in world.log if one.kind == "command" and isinstance(one.what, EngineCall)]
    assert calls[:2] == ["POST", "DELETE"]
    assert isinstance(next(one.what for one in world.log if one.kind == "command"), Run)


def test_all_that_is_replaced_is_stopped_by_one_script() -> None:
    world = up()
    assert run(world, changed(world)).exit_code == 0
    assert [line.count("srprov.hello") for line in stops(world)] == [3]


def test_one_alone_is_stopped_by_its_own_step() -> None:
    world = up()
    assert (
        run(world, plan_for(world, experiment(service("a"), service("b"), service("c", command=("x",))))).exit_code == 0
    )
    assert stops(world) == []


def test_what_another_is_replaced_for_first_runs_until_then() -> None:
    """`b` needs `a`, and is not stopped before `a` is there anew."""
    world = up()
    assert run(world, changed(world, depends_on={"a": "started"})).exit_code == 0
    (script,) = stops(world)
    assert "srprov.hello.a srprov.hello.c" in script and "srprov.hello.b" not in script
    names = [str(one.what.path) for one in world.log if one.kind == "done" and isinstance(one.what, EngineCall)]
    assert names.index("/containers/srprov.hello.a/start") < names.index("/containers/srprov.hello.b/stop")


def test_what_was_stopped_is_put_back_although_the_run_is_interrupted() -> None:
    """A container that was stopped with others is a step that is under way."""
    world, stop = up(), threading.Event()
    plan = changed(world)
    robot = world.robots["r1"]

    def interrupt(command: object) -> None:
        if isinstance(command, Run) and command.script.startswith("docker stop"):
            stop.set()

    robot.before_command = interrupt  # type: ignore[method-assign]
    result = run_plan(plan, world.sessions(), lambda _event: None, QUICK, stop)
    assert result.interrupted
    assert {one.outcome for one in result.results if one.step.module == "container"} == {Outcome.CHANGED}
    assert {one.state for one in robot.engine.containers.values()} == {"running"}


@pytest.mark.parametrize("most", [0, 1])
def test_with_a_budget_of_failing_robots_each_is_stopped_by_its_own_step(most: int) -> None:
    """The budget is looked at before each step, and what is not done then must run on."""
    world = up()
    assert run(world, changed(world), RunOptions(settle_s=0, max_fail=most)).exit_code == 0
    assert stops(world) == []
