"""What robots' programs say is put together; whoever says nothing of an endpoint is named."""

from __future__ import annotations

import json
from typing import Any

import pytest

from srprov.controller.report import overlay_failures
from srprov.execution import Outcome, RunResult, StepResult
from srprov.execution.probing import OverlayProbe, bring, probe_once
from srprov.planning.plan import Step
from srprov.probing.document import problems
from srprov.probing.verdict import Probed
from srprov.resource import Action, Change, Observed
from srprov.wire import Reply, Run
from tests.unit.probing.worlds import ROBOTS, name_of, request

WHOLE = request()


class Robot:
    """A session whose program says what it is told."""

    def __init__(self, said: str, status: str = "running") -> None:
        self.said, self.status = said, status
        self.scripts: list[str] = []

    def ask(self, queries: Any) -> list[Reply]:
        body = json.dumps({"State": {"Pid": 7 * (self.status == "running"), "Status": self.status}})
        return [Reply(status=200, out=body, ok=True) for _ in queries]

    def execute(self, command: Any) -> Reply:
        assert isinstance(command, Run)
        self.scripts.append(command.script)
        return Reply(status=0, out=self.said if "/proc/self/fd/8" in command.script else "", ok=True)


def lines(robot: str) -> list[str]:
    """Return what a program says when all works."""
    count = range(len(WHOLE.endpoints))
    rows = [[at, 5, 5, 10, 20, 30, 1, 1600, 0, 1, 1, 0, 0, 0, ""] for at in count]
    return [json.dumps({"self": at, "ms": 3, "failed": "", "error": 0, "peers": rows}) for at in WHOLE.of(robot)]


def tried(said: dict[str, str]) -> Probed:
    sessions: Any = {robot: Robot(said[robot]) for robot in ROBOTS}
    return Probed(found=probe_once(OverlayProbe(request=WHOLE, architectures=dict.fromkeys(ROBOTS, "amd64")), sessions))


def test_a_robot_that_is_silent_of_some_of_its_endpoints_is_named() -> None:
    """Its program ended in the middle, or it leaves out what does not work: that does not count as tried."""
    whole = {robot: "\n".join(lines(robot)) for robot in ROBOTS}
    assert tried(whole).json()["ok"]
    own = [name_of(WHOLE, at) for at in WHOLE.of("r2")]
    assert own.index("s2") == len(own) - 1
    said = tried({**whole, "r2": "\n".join(lines("r2")[:-1])}).json()
    assert said["unreachable"] == {"r2": "its probe says nothing of s2@r2"}
    assert not said["ok"]
    assert "does not run there" in tried({**whole, "r2": "nonsense"}).json()["unreachable"]["r2"]


def test_a_program_that_was_brought_is_not_sent_again_and_one_that_was_not_is() -> None:
    """All have the same, by the word that packets have."""
    sessions: Any = {robot: Robot("\n".join(lines(robot))) for robot in ROBOTS}
    probing = OverlayProbe(request=WHOLE, architectures=dict.fromkeys(ROBOTS, "amd64"))
    brought = bring(probing, {robot: sessions[robot] for robot in ROBOTS[1:]})
    assert brought.robots == {*ROBOTS[1:]}
    assert probe_once(probing, sessions, brought).lost == {}
    sent = {robot: [one for one in sessions[robot].scripts if "base64 -d" in one] for robot in ROBOTS}
    assert {robot: len(one) for robot, one in sent.items()} == dict.fromkeys(ROBOTS, 1)
    assert all(brought.magic in one[0] for one in sent.values())


@pytest.mark.parametrize(
    ("status", "why"),
    [
        ("exited", "its container has ended"),
        ("created", "its container was never started"),
        ("paused", "its container is paused"),
        ("", "its container is not running"),
    ],
)
def test_a_service_that_does_not_run_is_named_with_why(status: str, why: str) -> None:
    sessions: Any = {robot: Robot("\n".join(lines(robot)), status) for robot in ROBOTS}
    found = probe_once(OverlayProbe(request=WHOLE, architectures=dict.fromkeys(ROBOTS, "amd64")), sessions)
    assert set(found.left_out.values()) == {why}
    assert f"not probed: s2: {why}" in problems(Probed(found=found).json())


def test_an_apply_does_not_name_jobs_that_have_ended_nor_a_failure_twice() -> None:
    """Of a service that a step is not about, nobody has said why it was not tried."""
    sessions: Any = {robot: Robot("\n".join(lines(robot)), "exited") for robot in ROBOTS}
    probed = Probed(
        found=probe_once(OverlayProbe(request=WHOLE, architectures=dict.fromkeys(ROBOTS, "amd64")), sessions)
    )
    services = sorted(probed.found.left_out)
    assert len(services) > 2

    def result(service: str, outcome: Outcome, *, job: bool = False) -> StepResult:
        found = Observed(
            module="container", name=f"srprov.x.{service}", instance="x", state={"job": job, "service": service}
        )
        change = Change(action=Action.UPDATE, cause="so")
        step = Step(number=1, host="r1", module="container", name=found.name, change=change, found=found)
        return StepResult(step=step, outcome=outcome)

    results = (result(services[0], Outcome.FAILED), result(services[1], Outcome.CHANGED, job=True))
    told = overlay_failures(RunResult(results=results, unchanged=0, probed=probed))
    named = [line.split(": ")[1] for line in told if line.startswith("not probed: ")]
    assert named == services[2:]
