"""A search for a placement has a limit in every verb, and an answer that is not proved says so."""

from __future__ import annotations

import click
import pytest
from msgspec.structs import replace

from srprov.assignment import solve
from srprov.assignment.model import Assignment, Problem
from srprov.cli.apply import apply
from srprov.cli.assign import assign
from srprov.cli.plan import plan
from srprov.controller.request import SEARCH_LIMIT_S
from tests.fakes import World
from tests.worlds import experiment, plan_for, service

GAP = 0.25


@pytest.fixture
def limits(monkeypatch: pytest.MonkeyPatch) -> list[float | None]:
    """Return the limits that searches get; each search is stopped with an answer that may not be the best."""
    seen: list[float | None] = []
    really = solve.solve

    def stopped(problem: Problem, seconds: float | None = None) -> Assignment:
        seen.append(seconds)
        return replace(really(problem, seconds), optimal=False, gap=GAP)

    monkeypatch.setattr(solve, "solve", stopped)
    return seen


def test_a_plan_says_that_its_placement_is_not_proved(limits: list[float | None]) -> None:
    made = plan_for(World().add("a", "b"), experiment(service("talker")))
    assert limits == [SEARCH_LIMIT_S]
    assert "the search for the best placement was stopped; 0.250 less may be possible" in made.notes


def test_the_user_sets_the_limit(limits: list[float | None]) -> None:
    plan_for(World().add("a", "b"), experiment(service("talker")), search_limit_s=1.5)
    assert limits == [1.5]


def test_a_proved_placement_says_nothing_of_it() -> None:
    assert plan_for(World().add("a", "b"), experiment(service("talker"))).notes == ()


@pytest.mark.parametrize("verb", [apply, assign, plan])
def test_every_verb_that_decides_has_the_same_limit(verb: click.Command) -> None:
    options = {one.name: one.default for one in verb.params}
    assert options["time_limit"] == SEARCH_LIMIT_S
