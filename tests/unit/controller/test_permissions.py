"""Permissions are checked in one place: before a plan is made, and before it is done."""

from __future__ import annotations

import pytest

from srprov.controller.permissions import check_kinds, permit_planning, permit_run
from srprov.errors import RefusedError, UsageError
from srprov.planning.policy import permissions
from tests.fakes import World
from tests.worlds import experiment, plan_for, service

HOST = experiment(service("web", network="host"))


def test_a_plan_is_not_done_without_what_it_asks_for() -> None:
    plan = plan_for(World().add("r1"), HOST)
    with pytest.raises(RefusedError, match=r"web: host-network \(the robot's network \(") as caught:
        permit_run(plan, ("device",))
    assert caught.value.exit_code == 9
    assert caught.value.hint == "if you trust it: --allow host-network"


@pytest.mark.parametrize("allowed", [("host-network",), ("all",)])
def test_a_plan_may_be_done_with_it(allowed: tuple[str, ...]) -> None:
    permit_run(plan_for(World().add("r1"), HOST), allowed)


def test_a_plan_may_be_made_without_what_only_doing_it_needs() -> None:
    permit_planning(permissions(HOST), ())


def test_a_kind_that_is_none_is_no_permission() -> None:
    with pytest.raises(UsageError, match="--allow knows no kind host-netwrok"):
        check_kinds(("host-netwrok",))


def test_kinds_with_a_comma_are_said_one_by_one() -> None:
    with pytest.raises(UsageError) as caught:
        check_kinds(("device,gpu",))
    assert caught.value.hint.startswith("one --allow for each kind; known: ")
