"""Trials on robots that go away and come back: who is awaited is said, and what died with an engine does not count."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from typing import Any

import pytest

from srprov.codes import Code
from srprov.errors import TransportError
from srprov.execution import trial_patience
from srprov.execution.trial_patience import EngineAway, EquipmentFailed, RobotRestarted
from srprov.execution.trial_robots import TrialContainer, TrialRobots
from srprov.wire import Command, EngineCall, EngineQuery, Reply

AWAY = Reply(status=0, ok=False, err="the Docker Engine closed the connection")
EARLIER, LATER = "2026-11-22T10:00:00Z", "2026-11-22T10:00:09Z"


class Robot:
    """A robot with one container, whose engine or connection is away for some of the next requests."""

    host = "r1"

    def __init__(self) -> None:
        self.state: dict[str, Any] = {}
        self.engine_away = self.cut = 0
        self.done: list[str] = []
        self.meanwhile: Callable[[], None] = lambda: None
        """What happens to the container while they are away."""

    def _gone(self) -> bool:
        if self.cut:
            self.cut -= 1
            self.meanwhile()
            raise TransportError(self.host, "lost contact", code=Code.LOST)
        if self.engine_away:
            self.engine_away -= 1
            self.meanwhile()
            return True
        return False

    def execute(self, command: Command, _progress: object = None) -> Reply:
        if self._gone():
            return AWAY
        assert isinstance(command, EngineCall)
        self.done.append(f"{command.method} {command.path}")
        if command.path.endswith("/start"):
            self.state = {"Status": "running", "StartedAt": EARLIER}
        return Reply(status=204)

    def ask(self, queries: Sequence[object]) -> list[Reply]:
        if self._gone():
            return [AWAY for _ in queries]
        about = {"State": self.state, "GoVersion": "go1.25.1"}  # such an engine is led nowhere
        return [Reply(status=200, out=json.dumps(about)) for _ in queries]

    def dies(self) -> None:
        self.state = {"Status": "exited", "ExitCode": 0, "StartedAt": EARLIER, "FinishedAt": LATER}

    def starts_again(self) -> None:
        self.state = {"Status": "running", "StartedAt": LATER}


class Connections:
    def __init__(self, robot: Robot) -> None:
        self.robot, self.renewed = robot, 0

    def get(self, _host: str) -> Any:
        return self.robot

    def renew(self, _host: str) -> None:
        self.renewed += 1


@pytest.fixture(autouse=True)
def _no_pause(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trial_patience, "_PAUSE_S", 0.0)


def made(robot: Robot) -> tuple[TrialRobots, list[str], Connections]:
    create = EngineCall(method="POST", path="/containers/create", body="{}")
    said: list[str] = []
    one = TrialContainer(host="r1", service="a", name="a", create=(create,))
    connections = Connections(robot)
    return TrialRobots(connections, [one], said.append), said, connections


def test_an_engine_that_is_away_while_containers_are_made_is_waited_for_and_that_is_said() -> None:
    robot = Robot()
    robot.engine_away = 3
    robots, said, connections = made(robot)
    robots.create()
    robots.start({"a"})
    assert robots.look()["a"].state == "running"
    assert robot.done == ["DELETE /containers/a", "POST /containers/create", "POST /containers/a/start"]
    assert said == [
        "waiting for r1, up to 120 s: the Docker Engine closed the connection",
        "r1 is back after 0 s",
    ]
    assert connections.renewed == 0, "its connection was not lost"


@pytest.mark.parametrize("fate", [Robot.dies, Robot.starts_again])
def test_what_dies_with_its_engine_is_no_data(fate: Callable[[Robot], None]) -> None:
    """Also with exit code 0: an engine asks its containers to end when it ends, and starts some of them again."""
    robot = Robot()
    robots, _, _ = made(robot)
    robots.create()
    robots.start({"a"})
    robots.look()
    robot.engine_away, robot.meanwhile = 1, lambda: fate(robot)
    with pytest.raises(EquipmentFailed, match="the Docker Engine of r1 was away and a did not survive it") as caught:
        robots.look()
    assert not isinstance(caught.value, RobotRestarted), "its network is there: the run goes on"


@pytest.mark.parametrize(("code", "refused"), [(0, False), (143, True)])
def test_an_engine_that_ends_its_containers_before_it_goes_spoils_the_trial(code: int, refused: bool) -> None:
    """It still answers then. What is asked again tells; once all is at home, only a failure is held against it."""
    robot = Robot()
    robots, _, _ = made(robot)
    robots.start({"a"})
    robots.look()
    robot.dies()
    robot.state["ExitCode"] = code
    assert robots.look()["a"].ended, "it answers"
    robot.engine_away = 1
    robots.on("a", lambda session: broken_off(session.ask([EngineQuery(path="/_ping")])[0]))
    with pytest.raises(EquipmentFailed, match="did not survive") if refused else nullcontext():
        robots.refuse_doomed()
    with pytest.raises(EquipmentFailed, match="did not survive"):
        robots.look()


def broken_off(reply: Reply) -> None:
    """Fail as a log does whose engine goes away."""
    if not reply.ok:
        raise EngineAway(reply.err)


def test_what_lives_through_its_engines_restart_goes_on() -> None:
    robot = Robot()
    robots, _, _ = made(robot)
    robots.start({"a"})
    robots.look()
    robot.engine_away = 2
    assert robots.look()["a"].state == "running"
    robot.dies()
    assert robots.look()["a"].ended, "its own end, later"


@pytest.mark.parametrize("ended", [False, True])
def test_a_container_that_somebody_removed_spoils_the_trial(ended: bool) -> None:
    """Its log and its exit code are gone, so `until: {after: 30s}` would count what nobody knows anything of."""
    robot = Robot()
    robots, _, _ = made(robot)
    robots.create()
    assert robots.look()["a"].state == "", "it is not there yet"
    robots.start({"a"})
    robots.look()
    if ended:
        robot.dies()
        robots.look()
    robots.stop({"a"}, 1.0)
    robot.state = {}
    with pytest.raises(EquipmentFailed, match="r1: the container of a is gone; somebody removed it"):
        robots.inspect()


def test_what_died_with_its_engine_is_not_started_a_second_time() -> None:
    robot = Robot()
    robots, _, _ = made(robot)
    robots.start({"a"})
    robot.engine_away, robot.meanwhile = 1, robot.dies
    with pytest.raises(EquipmentFailed, match="did not survive"):
        robots.start({"a"})
    assert robot.done.count("POST /containers/a/start") == 1


def test_what_ended_while_only_the_connection_was_lost_is_data() -> None:
    robot = Robot()
    robots, said, connections = made(robot)
    robots.start({"a"})
    robots.look()
    robot.cut, robot.meanwhile = 1, robot.dies
    assert robots.look()["a"].ended
    assert connections.renewed == 1
    assert said[0] == "waiting for r1, up to 120 s: lost contact"


def test_a_robot_that_boots_is_told_from_an_engine_that_blinks() -> None:
    """Its connection is lost first, and its engine begins after its sshd: the network is gone, so the run ends."""
    robot = Robot()
    robots, _, _ = made(robot)
    robots.start({"a"})
    robots.look()
    robot.cut, robot.engine_away, robot.meanwhile = 1, 1, robot.dies
    with pytest.raises(RobotRestarted, match="a did not survive it: it was restarted"):
        robots.look()


def test_one_who_stays_away_is_named_again_and_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trial_patience, "PATIENCE_S", 0.2)
    monkeypatch.setattr(trial_patience, "_PAUSE_S", 0.02)
    monkeypatch.setattr(trial_patience, "_REMIND_S", 0.05)
    robot = Robot()
    robot.cut = 1000
    robots, said, _ = made(robot)
    with pytest.raises(EquipmentFailed, match="r1: lost contact"):
        robots.create()
    assert said[0].startswith("waiting for r1, up to 0.2 s")
    assert any(line.startswith("still waiting for r1, ") for line in said[1:])
    count = len(said)
    with pytest.raises(EquipmentFailed, match="r1: lost contact"):
        robots.clear()
    assert len(said) == count, "it is not waited for once more"


def test_a_log_that_breaks_off_with_its_engine_is_fetched_again() -> None:
    robot = Robot()
    robots, said, connections = made(robot)
    robot.engine_away = 2
    tries: list[int] = []

    def fetch(_session: object) -> str:
        tries.append(1)
        if robot.engine_away:
            raise TransportError("r1", "the log of a ended", code=Code.LOST)
        return "whole"

    assert robots.on("a", fetch) == "whole"
    assert (len(tries), len(said), connections.renewed) == (3, 2, 0), "its connection was not lost"


def test_an_engine_that_refuses_is_not_waited_for() -> None:
    robot = Robot()
    robot.execute = lambda *_: Reply(status=500, ok=False, err="no")  # type: ignore[method-assign]
    robots, said, _ = made(robot)
    with pytest.raises(EquipmentFailed, match="a on r1: no"):
        robots.clear()
    assert said == []


def test_what_an_engine_says_of_a_container_has_a_length() -> None:
    """It is kept for all containers of a trial."""
    robot = Robot()
    robot.state = {"Status": "running", "x": ["x" * 1000] * 600}
    robots = TrialRobots(Connections(robot), [TrialContainer(host="r1", service="a", name="a", create=())])
    with pytest.raises(EquipmentFailed, match="longer than any needs"):
        robots.inspect()
