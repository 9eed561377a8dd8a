"""An image for another architecture, or one that says too much of itself, is a failure, and loses its name."""

from __future__ import annotations

import json
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, cast

import pytest

from srprov.execution.unfit_image import unfit
from srprov.modules.image import ImageParams
from srprov.session import Session
from srprov.wire import AnyQuery, EngineCall, Reply


class Robot:
    """An engine with one image."""

    def __init__(self, said: object, reply: Reply | None = None) -> None:
        self.asked, self.done = list[str](), list[str]()
        self.reply = reply or Reply(status=200, out=json.dumps(said))

    def ask(self, queries: Sequence[AnyQuery]) -> Sequence[Reply]:
        self.asked += [getattr(one, "path", "") for one in queries]
        return [self.reply]

    def execute(self, command: EngineCall) -> Reply:
        self.done.append(f"{command.method} {command.path}")
        return Reply(status=200)


def outcome(robot: Robot, params: object) -> Reply | None:
    """Return what comes of an image that a step with these parameters has brought."""
    step: Any = SimpleNamespace(name="x:1", want=SimpleNamespace(params=params) if params else None)
    return unfit(step, cast(Session, robot))


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


@pytest.mark.parametrize("params", [ImageParams(source="pull"), ImageParams(source="copy", from_="r", runs=("arm64",))])
def test_an_architecture_is_not_compared_without_need(params: ImageParams) -> None:
    """A copy's is compared before it is loaded."""
    robot = Robot({"Architecture": "amd64"})
    assert outcome(robot, params) is None and robot.done == []


def test_what_brings_no_image_is_not_asked_for_one() -> None:
    robot = Robot({"Architecture": "amd64"})
    assert outcome(robot, None) is None and robot.asked == []


@pytest.mark.parametrize("params", [ImageParams(source="pull"), ImageParams(source="copy", from_="r")])
def test_an_image_that_says_too_much_of_itself_loses_its_name(params: ImageParams) -> None:
    """All ports of three protocols are 3 MB, in each list of its containers twice as much; a TURN server's are half."""
    every = {f"{port}/{kind}": {} for kind in ("tcp", "udp", "sctp") for port in range(1, 65_536)}
    robot = Robot({"Config": {"ExposedPorts": every}})
    refused = outcome(robot, params)
    assert refused is not None and "says more of itself than 1 MiB" in refused.err
    assert robot.done == ["DELETE /images/x:1"]
    relays = {name: {} for name in every if int(name.partition("/")[0]) >= 49_152 and not name.endswith("sctp")}
    assert outcome(Robot({"Config": {"ExposedPorts": relays}}), params) is None


def test_an_image_of_which_nothing_is_read_loses_its_name_and_a_silent_engine_is_told() -> None:
    robot = Robot({}, Reply(status=200, ok=False, err="longer than 8 MiB"))
    refused = outcome(robot, ImageParams(source="pull"))
    assert refused is not None and "longer than 8 MiB" in refused.err and robot.done == ["DELETE /images/x:1"]
    robot = Robot({}, Reply(status=0, ok=False, err="the Docker Engine did not answer within 20 s"))
    refused = outcome(robot, ImageParams(source="pull"))
    assert refused is not None and "did not answer" in refused.err and robot.done == []
    assert outcome(Robot({}, Reply(status=404, ok=False, err="no such image")), ImageParams(source="pull")) is None
