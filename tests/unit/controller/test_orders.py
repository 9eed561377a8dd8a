"""What a user stops and starts, and what no plan starts again: jobs that failed, services that are unhealthy."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
from msgspec.structs import replace

from srprov.controller.authority import check_file
from srprov.controller.located import locate
from srprov.controller.orders import Order, make_order
from srprov.controller.plan import Planned
from srprov.controller.report import jobs_under_way
from srprov.controller.request import PlanRequest
from srprov.controller.saved import check_plan, plan_file
from srprov.definitions.model import Definitions, Experiment
from srprov.errors import UsageError
from srprov.execution import Outcome
from srprov.facts.gather import Detail
from srprov.planning.planfile import dump
from srprov.planning.planread import load
from srprov.resource import Action
from tests import worlds
from tests.fakes import Behaviour, World
from tests.worlds import CHECK, apply, experiment, fleet, made, plan_for, run, service

CHAIN = experiment(
    service("base", robot="r1", healthcheck=CHECK),
    service("middle", robot="r2", depends_on={"base": "healthy"}),
    service("top", robot="r1", depends_on={"middle": "started"}),
)


def ordered(world: World, verb: str, *words: str, what: Experiment | None = CHAIN) -> Planned:
    """Make the plan of an order."""
    with worlds.remembering_all(world):
        snapshot = fleet(world).gather(Detail.BASIC)
        there = locate(snapshot, "hello", what)
        return make_order(Order(verb=verb, words=words), there, snapshot, there.by_name)


def steps(planned: Planned) -> list[tuple[str, Sequence[int], list[str]]]:
    """Return service, needs and waits of each step."""
    return [(one.service, one.needs, [need.id for need in one.waits]) for one in planned.plan.steps]


def states(world: World) -> dict[str, str]:
    """Return service -> state, of all containers."""
    return {one.service: one.state for robot in world.robots.values() for one in robot.engine.containers.values()}


def test_services_stop_before_what_they_depend_on_and_start_after_it() -> None:
    """A condition that takes time is waited for; what is so already needs no step."""
    w = World().add("r1", "r2")
    assert apply(w, CHAIN).exit_code == 0
    stop = ordered(w, "stop")
    assert steps(stop) == [("top", (), []), ("middle", (1,), []), ("base", (2,), [])]
    assert run(w, stop.plan).exit_code == 0
    assert set(states(w).values()) == {"exited"}
    assert ordered(w, "stop").plan.empty and ordered(w, "stop").plan.unchanged == 3
    start = ordered(w, "start")
    base = "r1/container:srprov.hello.base"
    assert steps(start) == [("base", (), []), ("middle", (1,), [base]), ("top", (2,), [])]
    assert run(w, start.plan).exit_code == 0
    assert set(states(w).values()) == {"running"} and plan_for(w, CHAIN).empty
    assert ordered(w, "start").plan.empty


def test_a_service_that_is_named_is_stopped_and_started_alone() -> None:
    """By the name of a service that runs several times, too; without a valid EDF by what robots have."""
    w = World().add("r1", "r2")
    what = experiment(replace(service("drone"), replicas=2), service("base", robot="r1"))
    apply(w, what)
    assert {one.service for one in ordered(w, "stop", "drone", what=what).plan.steps} == {"drone-1", "drone-2"}
    assert [one.service for one in ordered(w, "restart", "drone-2", what=what).plan.steps] == ["drone-2"]
    alone = ordered(w, "stop", "base", what=None)
    assert [one.service for one in alone.plan.steps] == ["base"]
    assert "the EDF is not valid: services are taken in the order of their names" in alone.plan.notes
    (note,) = ordered(w, "start", what=None).plan.notes
    assert note.endswith("; none that has ended is started: name those")
    with pytest.raises(UsageError, match="hello has no nobody"):
        ordered(w, "stop", "nobody", what=what)


def test_a_plan_afterwards_tells_what_was_stopped_and_mends_it() -> None:
    w = World().add("r1", "r2")
    apply(w, CHAIN)
    run(w, ordered(w, "stop", "top").plan)
    (step,) = plan_for(w, CHAIN).steps
    assert (step.service, step.change.action, step.change.cause) == ("top", Action.UPDATE, "exited with code 137")


def test_a_restart_that_does_not_stay_up_has_failed_and_one_that_ends_well_is_a_jobs() -> None:
    w = World().add("r1")
    what = experiment(service("a", robot="r1"), service("b", robot="r1", job=True))
    apply(w, what)
    behaviours = w.robots["r1"].engine.behaviours
    behaviours["a"], behaviours["b"] = Behaviour(exits=0, lives=0), Behaviour(exits=0, lives=0)
    for container in w.robots["r1"].engine.containers.values():
        container.looks = 0
    done = run(w, ordered(w, "restart", "a", "b", what=what).plan)
    found = {one.step.service: (one.outcome, one.message) for one in done.results}
    assert found["b"] == (Outcome.CHANGED, "")
    assert found["a"][0] is Outcome.FAILED and "exited with code 0" in found["a"][1]


def test_what_somebody_else_started_or_stopped_meanwhile_is_left_so() -> None:
    w = World().add("r1", "r2")
    apply(w, CHAIN)
    planned = ordered(w, "stop", "top")
    w.robots["r1"].engine.containers["srprov.hello.top"].state = "exited"
    (result,) = run(w, planned.plan).results
    assert (result.outcome, result.message) == (Outcome.UNCHANGED, "somebody was faster")


def test_robots_that_are_away_count_only_where_they_run_what_was_named() -> None:
    w = World().add("r1", "r2")
    apply(w, CHAIN)
    w.robots["r2"].gone = True
    assert ordered(w, "stop", "base").plan.unreachable == {}
    away = ordered(w, "stop", "middle").plan
    assert away.empty and set(away.unreachable) == {"r2"}


def test_a_service_without_a_container_is_refused_when_it_is_named_and_noted_when_it_is_not() -> None:
    w = World().add("r1", "r2")
    apply(w, CHAIN)
    del w.robots["r2"].engine.containers["srprov.hello.middle"]
    with pytest.raises(UsageError, match="middle on r2 has no container"):
        ordered(w, "restart", "middle")
    every = ordered(w, "stop").plan
    assert [one.service for one in every.steps] == ["top", "base"]
    assert every.notes == ("middle on r2 has no container; `srprov apply` makes one",)


def test_the_record_of_an_order_can_be_applied_by_nobody() -> None:
    """In a plan file it would be a step that removes what it stops."""
    w = World().add("r1", "r2")
    apply(w, CHAIN)
    saved = load(dump(plan_file(ordered(w, "stop", "top"))), "plan.json")
    with pytest.raises(UsageError, match=r"the plan's steps are not those that srprov derives|contradicts itself"):
        check_file(saved, "plan.json")
        check_plan(saved, fleet(w), adopt=True, signed=True)


JOB = experiment(service("a", robot="r1", job=True), service("b", robot="r2", depends_on={"a": "completed"}))


def failed_job() -> World:
    """Return robots on which a job failed."""
    w = World().add("r1", "r2")
    w.robots["r1"].engine.behaviours["a"] = Behaviour(exits=7)
    assert apply(w, JOB).exit_code == 3
    return w


def test_a_job_that_failed_is_named_by_plans_and_started_by_none() -> None:
    """What waits for it is skipped, and says why; a user's own word starts it."""
    w = failed_job()
    whole = made(w, Definitions(experiment=JOB, containers={}), PlanRequest(adopt=True))
    (note,) = whole.amiss
    assert note == "a on r1 is a job that ended with code 7, and is left so; `srprov restart` starts it again"
    assert note in whole.plan.notes
    assert [step.service for step in whole.plan.steps if step.service] == ["b"]
    skipped = run(w, whole.plan).results[-1]
    assert skipped.outcome is Outcome.SKIPPED and "exited with code 7" in skipped.message
    w.robots["r1"].engine.behaviours["a"] = Behaviour(exits=0)
    every = ordered(w, "start", what=JOB).plan
    assert every.empty and "a on r1 is a job that ended with code 7; name it to run it again" in every.notes
    assert run(w, ordered(w, "start", "a", what=JOB).plan).exit_code == 0
    again = made(w, Definitions(experiment=JOB, containers={}), PlanRequest(adopt=True))
    assert again.amiss == () and run(w, again.plan).exit_code == 0
    done = ordered(w, "start", what=JOB).plan
    assert done.empty and done.notes == ()
    starts = len([entry for entry in w.log if (entry.kind, entry.what) == ("started", "srprov.hello.a")])
    (result,) = run(w, ordered(w, "start", "a", what=JOB).plan).results
    assert result.outcome is Outcome.CHANGED, "it was named"
    assert len([entry for entry in w.log if (entry.kind, entry.what) == ("started", "srprov.hello.a")]) == starts + 1


def test_a_job_that_failed_is_made_anew_when_it_is_another_one_or_gone() -> None:
    w = failed_job()
    other = experiment(service("a", robot="r1", job=True, command=("new",)), *list(JOB.services.values())[1:])
    assert plan_for(w, other).steps[0].change.action is Action.REPLACE
    del w.robots["r1"].engine.containers["srprov.hello.a"]
    assert ("a", Action.CREATE) in {(one.service, one.change.action) for one in plan_for(w, JOB).steps}


def test_a_plan_from_a_file_leaves_what_failed_alone_too() -> None:
    w = failed_job()
    whole = made(w, Definitions(experiment=JOB, containers={}), PlanRequest(exact=True, adopt=True))
    saved = load(dump(plan_file(replace(whole, definitions=None))), "plan.json")
    assert check_plan(saved, fleet(w), adopt=True, signed=True).plan.steps == whole.plan.steps


def test_an_unhealthy_service_is_named_and_counts_neither_as_right_nor_as_a_step() -> None:
    w = World().add("r1", "r2")
    apply(w, CHAIN)
    right = plan_for(w, CHAIN).unchanged
    w.robots["r1"].engine.behaviours["base"] = Behaviour(healthy_after=-1)
    plan = plan_for(w, CHAIN)
    assert plan.empty and plan.unchanged == right - 1
    assert "base on r1 is unhealthy, and is left so; `srprov restart` starts it again" in plan.notes
    other = experiment(
        service("base", robot="r1", healthcheck=CHECK, command=("new",)), *list(CHAIN.services.values())[1:]
    )
    assert [one.change.action for one in plan_for(w, other).steps] == [Action.REPLACE]


def test_an_apply_names_the_jobs_that_it_started_and_that_go_on() -> None:
    """One that has ended by then is done; a service that is none has nothing to end."""
    w = World().add("r1")
    what = experiment(service("long", job=True), service("short", job=True), service("robot"))
    w.robots["r1"].engine.behaviours["short"] = Behaviour(exits=0)
    (line,) = jobs_under_way(apply(w, what))
    assert line.startswith("long on r1 is a job and was started; `srprov wait` with --until completed:long")
    assert jobs_under_way(apply(w, what)) == []
    run(w, ordered(w, "stop", what=what).plan)
    (line,) = jobs_under_way(run(w, ordered(w, "start", "long", what=what).plan))
    assert line.startswith("long on r1 ")
