"""An image that was pulled or built for another architecture is a failure, and loses its name."""

from __future__ import annotations

import json
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, cast

import pytest

from srprov.execution.architecture import wrong_architecture
from srprov.modules.image import ImageParams
from srprov.session import Session
from srprov.wire import AnyQuery, EngineCall, Reply


class Robot:
    """An engine with one image."""

    def __init__(self, said: object) -> None:
        self.said, self.asked, self.done = said, list[str](), list[str]()

    def ask(self, queries: Sequence[AnyQuery]) -> Sequence[Reply]:
        self.asked += [getattr(one, "path", "") for one in queries]
        return [Reply(status=200, out=json.dumps(self.said))]

    def execute(self, command: EngineCall) -> Reply:
        self.done.append(f"{command.method} {command.path}")
        return Reply(status=200)


def outcome(robot: Robot, params: object) -> Reply | None:
    """Return what comes of an image that a step with these parameters has brought."""
    step: Any = SimpleNamespace(name="x:1", want=SimpleNamespace(params=params) if params else None)
    return wrong_architecture(step, cast(Session, robot))


def test_an_image_for_another_architecture_is_told_and_untagged() -> None:
    robot = Robot({"Architecture": "amd64"})
    refused = outcome(robot, ImageParams(source="pull", runs=("arm64", "arm")))
    assert refused is not None and not refused.ok
    assert refused.err.startswith("x:1: it is an image for amd64, and the robot runs arm64 and arm;")
    assert robot.done == ["DELETE /images/x:1"]
    built = outcome(robot, ImageParams(source="build", blob=b"", runs=("arm64",)))
    assert built is not None and "its base" in built.err


@pytest.mark.parametrize("said", [{"Architecture": "arm"}, {"Architecture": ""}, {}, None, [], {"Architecture": [1]}])
def test_what_the_robot_runs_or_nobody_can_tell_stays(said: object) -> None:
    robot = Robot(said)
    assert outcome(robot, ImageParams(source="pull", runs=("arm64", "arm"))) is None and robot.done == []


@pytest.mark.parametrize(
    "params", [None, ImageParams(source="pull"), ImageParams(source="copy", from_="r", runs=("arm64",))]
)
def test_nothing_is_asked_where_nothing_is_to_be_compared(params: object) -> None:
    """A copy is compared before it is loaded."""
    robot = Robot({"Architecture": "amd64"})
    assert outcome(robot, params) is None and robot.asked == []
