"""An interrupt always ends a run: running steps have a few seconds, stops a limit of their own."""

from __future__ import annotations

import threading
import time

import pytest

from srprov.execution import Outcome, RunOptions, ending, run_plan
from srprov.execution.options import hurried
from srprov.wire import EngineCall
from tests.fakes import World
from tests.worlds import QUICK, apply, experiment, plan_for, removal_for, service

DAY_S = 86_400.0
IMPATIENT = RunOptions(settle_s=0, patience_s=0.3)


def hanging(world: World, robot: str, begun: threading.Event, *, wakes: bool = True) -> threading.Event:
    """Let a robot's commands hang until its connection is closed, or, when it does not wake, until the test's end."""
    one, closed = world.robots[robot], threading.Event()
    close = one.close

    def closing() -> None:
        close()
        if wakes:
            closed.set()

    def hang(_command: object) -> None:
        begun.set()
        assert closed.wait(60)

    one.close = closing  # type: ignore[method-assign]
    one.before_command = hang
    return closed


@pytest.mark.parametrize("wakes", [True, False])
def test_a_step_that_does_not_end_is_cut_off_and_the_others_are_reported(
    monkeypatch: pytest.MonkeyPatch, wakes: bool
) -> None:
    """After the interrupt it has its seconds, then the connection is closed; what was done elsewhere stays done."""
    monkeypatch.setattr(ending, "CLOSING_S", 0.3)
    monkeypatch.setattr("srprov.execution.executor.CLOSING_S", 0.3)
    w = World().add("r1", "r2")
    plan = plan_for(w, experiment(service("a", robot="r1"), service("b", robot="r2")))
    stop, begun = threading.Event(), threading.Event()
    release = hanging(w, "r1", begun, wakes=wakes)
    done = threading.Event()
    heard: list[str] = []

    def interrupt() -> None:
        assert begun.wait(10) and done.wait(10)
        stop.set()

    def listen(event: object) -> None:
        heard.append(str(getattr(event, "text", "")))
        if getattr(event, "kind", "") == "end" and getattr(event, "host", "") == "r2":
            done.set()

    threading.Thread(target=interrupt, daemon=True).start()
    started = time.monotonic()
    result = run_plan(plan, w.sessions(), listen, IMPATIENT, stop)
    assert time.monotonic() - started < 10
    release.set()
    assert result.exit_code == 130 and dict(result.unreachable) == {}
    ends = {one.step.id: one for one in result.results}
    assert len(ends) == len(plan.steps)
    cut = {one.message for one in ends.values() if one.step.host == "r1"}
    assert cut == {"interrupted: it did not end within 0.3 s, and was cut off"}
    assert {one.outcome for one in ends.values() if one.step.host == "r1"} == {Outcome.NOT_REACHED}
    assert Outcome.CHANGED in {one.outcome for one in ends.values() if one.step.host == "r2"}
    assert "its step did not end: closing the connection" in heard
    assert w.robots["r1"].gone and not w.robots["r2"].gone


def stops(world: World) -> list[EngineCall]:
    """Return the stops that were sent."""
    return [
        entry.what for entry in world.done() if isinstance(entry.what, EngineCall) and entry.what.path.endswith("/stop")
    ]


@pytest.mark.parametrize(("grace_s", "limit_s", "given"), [(DAY_S, 60.0, "60"), (3.0, 60.0, "3"), (90.0, 0.0, "0")])
def test_a_stop_has_a_limit_of_its_own(grace_s: float, limit_s: float, given: str) -> None:
    """The engine kills the process after its own grace or after --stop-timeout, whichever comes first."""
    w = World().add("r1")
    apply(w, experiment(service("a", stop_grace_s=grace_s)))
    w.log.clear()
    options = RunOptions(settle_s=0, stop_timeout_s=limit_s)
    assert run_plan(removal_for(w), w.sessions(), lambda _event: None, options).exit_code == 0
    (stop,) = stops(w)
    assert stop.params == (("t", given),)
    assert stop.timeout_s == float(given) + 60


def test_who_gets_less_time_than_it_asks_for_is_named() -> None:
    """A database that may be killed in the middle of its last write is worth a line before the question."""
    w = World().add("r1")
    apply(w, experiment(service("a", stop_grace_s=DAY_S), service("b")))
    plan = removal_for(w)
    assert hurried(plan, DAY_S) == []
    (line,) = hurried(plan, 60.0)
    assert line.startswith("a on r1 asks for 86400 s to stop and is killed after 60 s")


def test_a_grace_without_end_breaks_nothing() -> None:
    """A robot's label may say any number; what is waited for is bounded, and fits what sockets take."""
    w = World().add("r1")
    apply(w, experiment(service("a")))
    (container,) = w.robots["r1"].engine.containers.values()
    container.body["Labels"]["srprov.stop-grace"] = "9" * 17
    w.log.clear()
    assert run_plan(removal_for(w), w.sessions(), lambda _event: None, QUICK).exit_code == 0
    assert [stop.timeout_s for stop in stops(w)] == [120.0]
