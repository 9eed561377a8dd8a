"""No robot answers: that is why nothing can be placed, not what services ask for."""

from __future__ import annotations

import pytest

from srprov.definitions.model import Definitions
from srprov.errors import NoAssignment, TransportError
from tests.fakes import World
from tests.worlds import experiment, made, service


def test_a_plan_without_any_robot_is_told_by_reach() -> None:
    definitions = Definitions(experiment=experiment(service("a")), containers={})
    world = World().add("r1", "r2")
    for robot in world.robots.values():
        robot.gone = True
    with pytest.raises(TransportError, match="no robot can be reached; r1: ") as refused:
        made(world, definitions)
    assert refused.value.exit_code == 4


def test_a_robot_that_answers_makes_it_a_question_of_placement() -> None:
    definitions = Definitions(experiment=experiment(*(service(name) for name in "abcdefghij")), containers={})
    world = World().add("r1", "r2")
    world.robots["r2"].gone = True
    with pytest.raises(NoAssignment):
        made(world, definitions)
