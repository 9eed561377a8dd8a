"""What engines say of containers, as it is kept: no value of a controller's environment stands in it."""

from __future__ import annotations

import json
from typing import Any

import pytest

from srprov.modules.container_commands import creation
from srprov.modules.container_taken import without_taken
from srprov.wire import EngineCall
from tests.fakes import World
from tests.worlds import experiment, plan_for, service


def test_variables_that_were_the_controllers_have_masks() -> None:
    """Also where the EDF that they are collected by takes them no more."""
    config: dict[str, Any] = {
        "Labels": {"srprov.taken": "* B PLACE"},
        "Env": ["A=1", "PLACE=x=y", "B=", "PLACE2=z", "B"],
    }
    found = without_taken({"web": {"Id": "1", "Config": config}, "gone": None})
    masked = {**config, "Env": ["A=1", "PLACE=***", "B=***", "PLACE2=z", "B"]}
    assert found == {"web": {"Id": "1", "Config": masked}, "gone": None}
    assert config["Env"][1] == "PLACE=x=y"


@pytest.mark.parametrize(
    "about", [None, 1, "x", [], {}, {"Config": 1}, {"Config": {"Labels": {"srprov.taken": "A"}, "Env": {"A": "b"}}},
              {"Config": {"Labels": {"srprov.taken": "A"}, "Env": [1, None, ["A=b"]]}}, {"Config": {"Env": ["A=b"]}}],
)  # fmt: skip
def test_what_a_robot_says_in_another_form_stays_as_it_is(about: object) -> None:
    assert without_taken({"web": about}) == {"web": about}


def test_an_image_does_not_say_what_of_its_container_is_hidden() -> None:
    """A container has its image's labels: `srprov.taken: *` of one hid its command from the next plan."""
    container = service("a", robot="r1")
    world = World().add("r1")
    (want,) = (one.want for one in plan_for(world, experiment(container)).steps if one.module == "container")
    assert want is not None
    create = next(one for one in creation(want.name, want.params) if isinstance(one, EngineCall))
    assert json.loads(create.body)["Labels"]["srprov.taken"] == ""
