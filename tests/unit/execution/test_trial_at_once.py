"""Robots are worked on at once; who fails first in order is told of, and an interrupt waits only where it must."""

from __future__ import annotations

import threading

import pytest

from srprov.execution.trial_at_once import at_once

_LIMIT_S = 20.0


def test_all_robots_are_worked_on_at_once() -> None:
    together = threading.Barrier(3)

    def work(host: str) -> str:
        together.wait(_LIMIT_S)
        return host.upper()

    assert at_once(["a", "b", "c"], work, threading.Event()) == {"a": "A", "b": "B", "c": "C"}


def test_the_first_robot_that_failed_is_told_of_and_nobody_waits_for_others_to_come_back() -> None:
    over = threading.Event()
    left = []

    def work(host: str) -> None:
        if host == "c":
            left.append(over.wait(_LIMIT_S))
            return
        raise ValueError(host)

    with pytest.raises(ValueError, match="a"):
        at_once(["a", "b", "c"], work, over)
    assert left == [True], "it was told, and waited for"


@pytest.mark.parametrize("leave", [True, False])
def test_an_interrupt_waits_for_work_unless_that_may_be_left(leave: bool) -> None:
    """The work goes on until it is told to end, which in the second case the interrupt itself does."""
    begun, ends = threading.Event(), threading.Event()
    ended: list[str] = []

    def work(host: str) -> None:
        if host == "a":
            assert begun.wait(_LIMIT_S)
            raise KeyboardInterrupt  # what a result raises is raised where it is waited for
        begun.set()
        ends.wait(_LIMIT_S)
        ended.append(host)

    class Over(threading.Event):
        def set(self) -> None:
            super().set()
            if not leave:
                ends.set()

    with pytest.raises(KeyboardInterrupt):
        at_once(["a", "b"], work, Over(), leave=leave)
    assert ended == ([] if leave else ["b"])
    ends.set()
