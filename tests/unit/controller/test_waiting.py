"""Before a plan is made, another run of the same instance is waited for as long as the user said."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any

import pytest

from srprov.codes import Code
from srprov.controller import waiting
from srprov.errors import LockHeld, TransportError
from srprov.wire import Reply


class Clock:
    """A clock that only sleeping moves."""

    now = 100.0

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    one = Clock()
    monkeypatch.setattr(waiting, "time", one)
    return one


def robots(clock: Clock, held: dict[str, tuple[str, float]], away: tuple[str, ...] = ()) -> Any:
    """Return robots that are held by somebody with a purpose, until so many seconds have passed."""

    def get(robot: str) -> Any:
        if robot in away:
            raise TransportError(robot, "no route", hint="", code=Code.LOST)
        purpose, until = held.get(robot, ("", 0.0))
        about = json.dumps({"owner": "anna@desk", "pid": 7, "purpose": purpose, "run": "x"})
        out = f"held 2026-11-21T02:00:00Z {about}\n" if clock.now < 100.0 + until else ""
        return SimpleNamespace(ask=lambda _queries: [Reply(status=0, out=out)])

    hosts = dict.fromkeys(("r1", "r2", *away))
    return SimpleNamespace(inventory=SimpleNamespace(hosts=hosts), sessions=SimpleNamespace(get=get), forks=4)


def test_it_waits_until_the_other_run_is_over(clock: Clock) -> None:
    said: list[str] = []
    held = robots(clock, {"r2": ("apply hello", 7.0)}, away=("r9",))
    left = waiting.wait_for_other_runs(held, "hello", 20.0, said.append, ["r1", "r2"])
    assert clock.now == 107.0 and left == 13.0
    assert len(said) == 2 and said[0].startswith("waiting up to 20 s for r2: held by anna@desk, process 7: apply hello")


@pytest.mark.parametrize("purpose", ["apply other", "destroy hello-2", "apply"])
def test_other_instances_are_not_waited_for(clock: Clock, purpose: str) -> None:
    assert waiting.wait_for_other_runs(robots(clock, {"r1": (purpose, 99.0)}), "hello", 20.0, print, ["r1"]) == 20.0
    assert clock.now == 100.0


def test_it_gives_up_in_time(clock: Clock) -> None:
    with pytest.raises(LockHeld, match=r"r1 is held by anna@desk.*destroy hello.*not free within 3 s") as raised:
        waiting.wait_for_other_runs(robots(clock, {"r1": ("destroy hello", 99.0)}), "hello", 3.0, print, ["r1"])
    assert clock.now == 103.0 and raised.value.exit_code == 7


def test_without_a_wish_nobody_is_asked(clock: Clock) -> None:
    nobody: Any = None
    assert waiting.wait_for_other_runs(nobody, "hello", 0.0, print, ["r1"]) == 0.0


def test_a_robot_that_takes_no_part_is_not_asked(clock: Clock) -> None:
    held = robots(clock, {"r2": ("apply hello", 99.0)})
    assert waiting.wait_for_other_runs(held, "hello", 8.0, print, ["r1"]) == 8.0 and clock.now == 100.0
