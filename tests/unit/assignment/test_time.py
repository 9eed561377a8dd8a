"""An experiment that is hard to place costs the time that was given for it, and a little for saying why."""

from __future__ import annotations

import time

import pytest

from srprov.assignment import conflict, explain, problem, solve
from srprov.assignment.model import Problem
from srprov.errors import NoAssignment
from tests.unit.assignment.worlds import experiment, found, robot, service


def hard(slots: int, robots: int = 4) -> Problem:
    """Return sixty services in pairs that must be apart, in a way that needs more robots than there are."""
    pairs = [(f"s{a}", f"s{b}") for a in range(60) for b in range(a + 1, 60) if (a * a + b) % 3 == 0 or b - a in (1, 2)]
    what = experiment(*(service(f"s{number}") for number in range(60)), different_robot=tuple(pairs))
    names = [f"r{number}" for number in range(robots)]
    return problem.build(what, {}, found(*map(robot, names)), {}, slots=dict.fromkeys(names, slots))


def test_why_there_is_no_placement_is_looked_for_within_its_own_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(explain, "_LONGEST_S", 0.5)
    begin = time.monotonic()
    with pytest.raises(NoAssignment) as refused:
        solve.solve(hard(slots=60), 0.5)
    assert time.monotonic() - begin < 30
    assert refused.value.exit_code == 8


def test_without_time_for_a_reason_that_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(explain, "_LONGEST_S", 0.01)
    error = explain.no_assignment(hard(slots=60))
    assert error.message == "no placement of 60 services was found, nor in 0.01 s why there is none"
    assert "--time-limit" in error.hint


def test_a_mere_lack_of_slots_is_told_however_hard_the_rest_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(explain, "_LONGEST_S", 0.01)
    assert "5 places needed, 4 there" in explain.no_assignment(hard(slots=1)).message


def test_what_was_not_decided_in_time_counts_neither_as_possible_nor_as_impossible() -> None:
    with conflict.time_limit(0.01), pytest.raises(conflict.OutOfTimeError):
        conflict.feasible(hard(slots=60))
