"""Which steps share a round trip, and what comes of each of them when another fails."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from srprov.execution import Outcome
from srprov.execution.robot import round_trip_size
from srprov.planning.plan import Step
from srprov.resource import Action, Change, Need
from srprov.wire import Command, EngineCall, Put, Run
from tests.fakes import Fault, World
from tests.worlds import apply, experiment, plan_for, run, service

LINK, FILE = Run(script="ip link add x"), Put(path="/x", content=b"x", mode=0o644)
CALL = EngineCall(method="POST", path="/x")
HEALTHY = Need(id="r2/container/a", condition="healthy")


def step(number: int, module: str, *commands: Command, needs: tuple[int, ...] = ()) -> Step:
    return Step(
        number=number,
        host="r1",
        module=module,
        name=str(number),
        change=Change(action=Action.CREATE, cause="missing", commands=commands),
        needs=needs,
    )


@pytest.mark.parametrize(
    ("steps", "count"),
    [
        ([step(1, "vxlan", LINK), step(2, "file", FILE), step(3, "file", FILE)], 3),
        ([step(1, "network", CALL), step(2, "vxlan", LINK)], 1),
        ([step(1, "file", FILE), step(2, "container", CALL)], 1),
        ([step(1, "vxlan", LINK, needs=(9,)), step(2, "file", FILE, needs=(1,))], 1),
        ([step(1, "file", FILE), step(2, "file", FILE, FILE)], 1),
        ([step(1, "command", LINK), step(2, "command", LINK)], 1),
        ([step(1, "secret", FILE), step(2, "secret", FILE)], 1),
        (
            [
                step(1, "file", FILE),
                replace(step(2, "file", FILE), waits=(HEALTHY,)),
            ],
            1,
        ),
        ([step(1, "file", Put(path="/x", content=b"x" * (1 << 20), mode=0o644)), step(2, "file", FILE)], 1),
        ([step(1, "file", FILE), step(2, "file", Put(path="/x", content=b"x" * (1 << 20), mode=0o644))], 1),
    ],
)
def test_which_steps_share_a_round_trip(steps: list[Step], count: int) -> None:
    assert round_trip_size(steps) == count


def test_one_that_fails_leaves_the_others_and_stops_what_needs_it() -> None:
    world = World().add("r1", "r2")
    what = experiment(service("a", robot="r1"), service("b", robot="r2"))
    plan = plan_for(world, what)
    short = [one for one in plan.steps if one.host == "r1" and one.module in ("vxlan", "file")]
    assert round_trip_size(short) == len(short) == 3
    before = [one for one in plan.steps if one.host == "r1" and one.number < short[0].number]
    world.robots["r1"].fault = Fault(at=sum(len(one.commands) for one in before) + 1)
    result = run(world, plan)
    seen = {one.step.number: one for one in result.results}
    assert seen[short[0].number].outcome is Outcome.FAILED
    assert "injected failure" in seen[short[0].number].message
    assert {seen[one.number].outcome for one in short[1:]} == {Outcome.CHANGED}
    assert {one.outcome for one in result.results if one.step.service == "a"} == {Outcome.SKIPPED}
    assert {one.outcome for one in result.results if one.step.host == "r2"} == {Outcome.CHANGED}
    assert apply(world, what).exit_code == 0
    assert plan_for(world, what).empty
