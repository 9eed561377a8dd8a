"""How many robots may fail, and which may be away."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from srprov.cli.options import budget
from srprov.errors import UsageError
from srprov.execution import Outcome
from tests.fakes import Fault, World
from tests.worlds import QUICK, experiment, plan_for, run, service


@pytest.mark.parametrize(("max_fail", "begins"), [(None, True), (1, True), (0, False)])
def test_no_step_begins_when_too_many_robots_failed(max_fail: int | None, begins: bool) -> None:
    """With the budget used up the rest is not reached and says why; within it the others go on."""
    w = World().add("r1", "r2")
    what = experiment(service("a", robot="r1"), service("b", robot="r2"))
    plan = plan_for(w, what)
    w.robots["r1"].fault = Fault(at=1)

    result = run(w, plan, replace(QUICK, max_fail=max_fail, forks=1))

    second = [one for one in result.results if one.step.host == "r2"]
    assert {one.outcome for one in second} == {Outcome.CHANGED if begins else Outcome.NOT_REACHED}
    assert begins or all("more than 0 robots" in one.message for one in second)
    assert result.exit_code == 3


@pytest.mark.parametrize(("tolerate", "code"), [(frozenset(), 4), (frozenset({"r9"}), 0), (frozenset({"r8"}), 4)])
def test_a_robot_that_may_be_away_is_no_failure(tolerate: frozenset[str], code: int) -> None:
    """Only the robots that the user said may be away do not count."""
    w = World().add("r1")
    plan = replace(plan_for(w, experiment(service("a", robot="r1"))), unreachable={"r9": "no route"})

    assert run(w, plan, replace(QUICK, tolerate=tolerate)).exit_code == code


@pytest.mark.parametrize(
    ("text", "robots", "expected"), [("", 10, None), ("0", 10, 0), ("3", 10, 3), ("25%", 10, 2), ("100%", 4, 4)]
)
def test_the_budget_is_a_number_or_a_share(text: str, robots: int, expected: int | None) -> None:
    """A share is of the robots that may be changed, rounded down."""
    assert budget(text, robots) == expected


@pytest.mark.parametrize("text", ["-1", "x", "1.5", "101%", "%"])
def test_a_budget_that_is_neither_is_refused(text: str) -> None:
    """A typing mistake is an error, not a budget of none."""
    with pytest.raises(UsageError, match="--max-fail"):
        budget(text, 10)
