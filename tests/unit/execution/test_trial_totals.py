"""What containers used is what was read last, whatever became of them since."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest

from srprov.execution import trial_totals
from srprov.execution.trial_totals import Totals
from srprov.wire import Query, Reply

MOUNTS = "/proc/self/mountinfo:25 30 0:23 / /sys/fs/cgroup rw - cgroup2 cgroup2 rw\n"
GROUP = "/sys/fs/cgroup/docker/a"


class Robot:
    """A robot that says what its files say."""

    def __init__(self) -> None:
        self.files: dict[str, str] = {}
        self.asked: list[str] = []

    def ask(self, queries: Sequence[Query]) -> list[Reply]:
        self.asked += [query.command for query in queries]
        shown = "".join(f"{path}:{line}\n" for path, text in self.files.items() for line in text.split("|"))
        return [Reply(status=0, out=shown) for _ in queries]

    def runs(self, pid: int, group: str = "docker/a", sent: int = 10, **counters: int) -> None:
        self.files = {
            f"/proc/{pid}/cgroup": f"0::/{group}",
            f"/proc/{pid}/net/dev": f"eth0: 1 0 0 0 0 0 0 0 {sent} 0 0",
            **{f"/sys/fs/cgroup/{group}/{name}": str(value) for name, value in counters.items()},
        }


@pytest.fixture(autouse=True)
def _always_due(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trial_totals, "_LONGEST_S", 0.0)


def look(totals: Totals, robot: Any, pid: int) -> dict[str, float | None]:
    """Look at the service once, as a trial does; return what is known of it then."""
    totals.take("r1", robot.ask(totals.due("r1")))
    totals.find("r1", {"a": {"State": {"Pid": pid}, "HostConfig": {"NetworkMode": "net"}}}, robot)
    used = totals.used()
    return {key: value for key, value in used["a"].counters.items() if value is not None} if used else {}


def begun() -> tuple[Totals, Robot]:
    totals, robot = Totals({}), Robot()
    totals.host("r1", Reply(status=0, out=MOUNTS))
    robot.runs(7)
    robot.files |= {f"{GROUP}/cpu.stat": "usage_usec 2500000|throttled_usec 0", f"{GROUP}/memory.peak": "4096"}
    assert look(totals, robot, 7) == {}, "where its files are is known now"
    return totals, robot


READ = {"cpu_s": 2.5, "throttled_s": 0.0, "memory_peak_bytes": 4096, "net_received_bytes": 1, "net_sent_bytes": 10}


def test_a_container_is_read_from_the_second_look_on() -> None:
    totals, robot = begun()
    assert look(totals, robot, 7) == READ
    assert robot.asked[-1].startswith("grep -sHa ''") and len(robot.asked) == 2, "one question a look"


def test_what_was_read_stays_when_the_container_is_gone() -> None:
    totals, robot = begun()
    look(totals, robot, 7)
    robot.files = {}
    assert look(totals, robot, 0) == READ


def test_a_process_with_the_number_of_one_that_ended_is_not_taken_for_it() -> None:
    totals, robot = begun()
    look(totals, robot, 7)
    robot.runs(7, "system.slice/other", sent=999_999)
    assert look(totals, robot, 0) == READ


def test_a_group_that_is_half_gone_takes_nothing_away() -> None:
    totals, robot = begun()
    look(totals, robot, 7)
    del robot.files[f"{GROUP}/cpu.stat"]
    assert look(totals, robot, 0) == READ


def test_a_container_that_was_started_again_adds_to_what_was() -> None:
    totals, robot = begun()
    look(totals, robot, 7)
    robot.runs(8, "docker/a2", sent=5)
    robot.files["/sys/fs/cgroup/docker/a2/cpu.stat"] = "usage_usec 500000"
    robot.files["/sys/fs/cgroup/docker/a2/memory.peak"] = "1024"
    look(totals, robot, 8)
    assert look(totals, robot, 8) == {**READ, "cpu_s": 3.0, "net_received_bytes": 2, "net_sent_bytes": 15}
