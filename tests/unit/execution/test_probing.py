"""What robots' programs say is put together; whoever says nothing of an endpoint is named."""

from __future__ import annotations

import json
from typing import Any

from srprov.execution.probing import OverlayProbe, probe_once
from srprov.probing.verdict import Probed
from srprov.wire import Put, Reply, Run
from tests.unit.probing.worlds import ROBOTS, name_of, request

WHOLE = request()


class Robot:
    """A session whose program says what it is told."""

    def __init__(self, said: str) -> None:
        self.said = said

    def ask(self, queries: Any) -> list[Reply]:
        body = json.dumps({"State": {"Pid": 7, "Status": "running"}})
        return [Reply(status=200, out=body, ok=True) for _ in queries]

    def execute(self, command: Any) -> Reply:
        assert isinstance(command, Put | Run)
        return Reply(status=0, out=self.said if isinstance(command, Run) else "", ok=True)


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
