"""What services use at the moment, from two readings."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from typing import Any

import pytest

from srprov.codes import Code
from srprov.controller.live import Live
from srprov.errors import TransportError
from srprov.wire import EngineQuery, Query, Reply

MOUNTS = "/proc/self/mountinfo:25 30 0:23 / /sys/fs/cgroup rw - cgroup2 cgroup2 rw\n"


class Robot:
    """A robot with one container, which has used so much."""

    def __init__(self) -> None:
        self.used_us, self.held, self.cut = 1_000_000, 4096, False

    def ask(self, queries: Sequence[object]) -> list[Reply]:
        if self.cut:
            raise TransportError("r1", "lost contact", code=Code.LOST)
        return [self._answer(query) for query in queries]

    def _answer(self, query: object) -> Reply:
        if isinstance(query, EngineQuery):
            return Reply(status=200, out=json.dumps({"State": {"Pid": 7}}))
        assert isinstance(query, Query)
        group = "/sys/fs/cgroup/docker/a"
        said = f"{group}/cpu.stat:usage_usec {self.used_us}\n{group}/memory.stat:anon {self.held}\n"
        return Reply(status=0, out=f"{MOUNTS}/proc/7/cgroup:0::/docker/a\n/proc/7/net/dev:lo\n{said}")


def test_cpu_is_known_from_the_second_look_on_and_memory_is_that_of_now(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, live, now = Robot(), Live(), [1000.0]
    monkeypatch.setattr(time, "time", lambda: now[0])
    rows: list[dict[str, Any]] = [
        {"robot": "r1", "container": "a", "service": "hog"},
        {"robot": "r2", "container": "b", "service": "elsewhere"},
        {"robot": "r1", "container": "", "service": "missing"},
    ]

    def look() -> list[tuple[float | None, float | None]]:
        found = live.rows(rows, {"r1": robot})  # type: ignore[dict-item]  # as much of a session as is used
        assert [row["service"] for row in found] == ["hog", "elsewhere", "missing"]
        return [(row["cpu_percent"], row["memory_bytes"]) for row in found]

    nothing = (None, None)
    assert look() == [(None, 4096), nothing, nothing]
    robot.used_us, robot.held, now[0] = 2_500_000, 1024, 1002.0
    assert look() == [(75.0, 1024), nothing, nothing]
    robot.cut = True
    assert look() == [nothing] * 3
    robot.cut, robot.used_us, now[0] = False, 2_500_000, 1004.0
    assert look()[0] == (0.0, 1024)
