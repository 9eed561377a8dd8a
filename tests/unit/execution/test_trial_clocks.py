"""A robot is asked for its time until that gets no faster; the bound of the error holds however often that is."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any, cast

import pytest

from srprov.execution import trial_clocks
from srprov.session import Session
from srprov.trials.clock import offset
from srprov.wire import Query, Reply

_AHEAD_S = 1.5
_LAST = Query(command="counters")


class Robot:
    """A robot whose answers take given times, of which its clock's reading is at the end."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, took_s: Sequence[float]) -> None:
        self.now, self.left, self.asked = 1000.0, list(took_s), 0
        monkeypatch.setattr(time, "time", lambda: self.now)
        monkeypatch.setattr(time, "monotonic", lambda: self.now)

    def ask(self, queries: Sequence[Any]) -> list[Reply]:
        if queries == [_LAST]:
            return [Reply(status=0, out="counted")]
        self.asked += 1
        self.now += self.left.pop(0)
        return [Reply(status=0, out=f"{self.now + _AHEAD_S:.9f}\n") for _ in queries]

    def offset(self) -> Any:
        found, last = trial_clocks.samples(cast(Session, self), _LAST)
        assert last.out == "counted"
        return offset(found)


@pytest.mark.parametrize(
    ("took_ms", "asked", "best_ms"),
    [
        ([3.0] * 16, 6, 3.0),
        ([9, 3, 3.2, 3.1, 2.9, 4, 3, 1], 7, 2.9),
        ([9, 8, 7, 6, 5, 4, 3, 2, 2, 2, 2, 2, 2], 13, 2),
        ([0.8**number for number in range(16)], 16, 0.8**15),
    ],
    ids=["steady", "soon steady", "faster for long", "faster for ever"],
)
def test_a_robot_is_asked_until_five_answers_in_a_row_are_hardly_faster(
    monkeypatch: pytest.MonkeyPatch, took_ms: list[float], asked: int, best_ms: float
) -> None:
    robot = Robot(monkeypatch, [one / 1000 for one in took_ms])
    found = robot.offset()
    assert (robot.asked, found.samples) == (asked, asked)
    assert found.error_s == pytest.approx(best_ms / 2000)
    assert abs(found.offset_s - _AHEAD_S) <= found.error_s + 1e-9


def test_a_robot_that_never_tells_its_time_is_asked_six_times_and_has_no_offset(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    robot = Robot(monkeypatch, [0.001] * 16)
    monkeypatch.setattr(robot, "ask", lambda _queries: [Reply(status=127, out="counted", ok=False)])
    assert robot.offset() is None
