"""Experiments that change, wait for each other, and fail: exactly what must happen happens, in the right order.

Every test has an instance of its own on robots that nobody else changes at that moment, so nothing has to be cleaned in
between.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.lab.conftest import Done, Lab, busybox, causes, changed, edf, only_the_record, part_of_lab

pytestmark = pytest.mark.lab

SLOW = {"stop_signal": "SIGTERM", "stop_grace_period": "2s"}
"""`sleep` as the first process ignores SIGTERM: who does not wait for its end starts the next one too early."""


@dataclass
class Trial:
    """One experiment on some robots."""

    lab: Lab
    name: str
    robots: Sequence[str]
    folder: Path

    def run(self, verb: str, services: dict[str, dict[str, Any]], *words: str, **more: Any) -> Done:
        """Write the EDF and run a verb on it."""
        path = self.folder / "experiment.edf"
        path.write_text(edf(self.name, services, **more), encoding="utf-8")
        inventory = part_of_lab(self.lab, self.robots, self.folder / "lab.yml")
        return self.lab.srprov(verb, str(path), "-i", inventory, "--json", *words)

    def apply(self, services: dict[str, dict[str, Any]], *words: str, code: int = 0, **more: Any) -> Done:
        done = self.run("apply", services, "--yes", *(words or ("--settle", "0")), **more)
        assert done.code == code, done
        return done

    def name_of(self, service: str) -> str:
        return f"srprov.{self.name}.{service}"

    def state(self, robot: str, service: str) -> dict[str, Any]:
        """Give Docker's `State` of a service's container; its times compare as text, all being UTC."""
        state = self.lab.inspect(robot, self.name_of(service))["State"]
        assert isinstance(state, dict)
        return state

    def outcome(self, done: Done, robot: str, service: str) -> tuple[str, str]:
        """Give outcome and message of a container's step."""
        wanted = f"{robot}/container:{self.name_of(service)}"
        (step,) = (step for step in done.json["steps"] if step["id"] == wanted)
        return step["outcome"], step["message"]

    def now(self) -> str:
        """Give the time of the robots, which have one clock."""
        return self.lab.shell(self.robots[0], "date", "+%s.%N").out.strip()

    def events(self, robot: str, since: str) -> list[tuple[int, str, str]]:
        """Give Docker's own record of what happened to containers: nanoseconds, action, service."""
        words = ("--since", since, "--until", self.now(), "--filter", "type=container", "--format", "{{json .}}")
        lines = map(json.loads, self.lab.shell(robot, "docker", "events", *words).out.splitlines())
        return [(e["timeNano"], e["Action"], e["Actor"]["Attributes"]["name"].rpartition(".")[2]) for e in lines]

    def times(self, robot: str, since: str, service: str, wanted: str) -> list[int]:
        """Give when an action happened to a service's container."""
        return [when for when, action, name in self.events(robot, since) if (action, name) == (wanted, service)]

    def named(self, robot: str, service: str) -> set[str]:
        """Give the names that a service's container knows, from inside it."""
        text = self.lab.shell(robot, "docker", "exec", self.name_of(service), "cat", "/etc/hosts").out
        return {word for line in text.splitlines() for word in line.split()[1:]}


@pytest.fixture
def trial(lab_of_module: Lab, tmp_path: Path) -> Any:
    """Give a function that begins an experiment on some robots."""
    return lambda name, *robots: Trial(lab_of_module, name, robots, tmp_path)


def test_a_service_is_changed_and_another_is_removed(trial: Any) -> None:
    """A changed environment replaces that one container, a service that is gone from the EDF goes, others stay."""
    one = trial("edits", "robot1", "robot2", "robot3")
    services = {
        "stays": busybox(robot="robot1"),
        "edited": busybox(robot="robot2", environment={"SPEED": "1"}),
        "leaves": busybox(robot="robot3"),
    }
    one.apply(services)
    before = one.lab.everywhere(one.robots)

    services["edited"]["environment"]["SPEED"] = "2"
    container = f"robot2/container:{one.name_of('edited')}"
    assert causes(one.run("plan", services).json) == {container: "replace: environment differs"}
    assert changed(one.apply(services).json) == {container}
    after = one.lab.everywhere(one.robots)
    assert (after["robot1"], after["robot3"]) == (before["robot1"], before["robot3"])
    assert after["robot2"].keys() == before["robot2"].keys() and after["robot2"] != before["robot2"]
    inside = one.lab.shell("robot2", "docker", "exec", one.name_of("edited"), "sh", "-c", "echo $SPEED").out
    assert inside == "2\n"

    del services["leaves"]
    plan = one.run("plan", services)
    steps = causes(plan.json)
    assert steps[f"robot3/container:{one.name_of('leaves')}"] == "delete: no longer in the experiment"
    assert {step for step in steps if "/container:" in step} == {f"robot3/container:{one.name_of('leaves')}"}
    one.apply(services)
    assert one.lab.leftovers("robot3") == only_the_record("edits")
    assert {r: one.lab.containers(r) for r in ("robot1", "robot2")} == {r: after[r] for r in ("robot1", "robot2")}
    for robot, service, other in (("robot1", "stays", "edited"), ("robot2", "edited", "stays")):
        ping = ("docker", "exec", one.name_of(service), "ping", "-c", "1", "-W", "2")
        one.lab.shell(robot, *ping, other)
        assert one.named(robot, service) >= {"stays", "edited"}
        assert "leaves" not in one.named(robot, service)
    assert causes(one.run("plan", services).json) == {}


def test_a_service_moves_with_its_address_and_never_runs_twice(trial: Any) -> None:
    """With another pin the old container has ended before the new one starts, and the address goes along."""
    one = trial("moves", "robot4", "robot5", "robot6")
    services = {"mover": busybox(robot="robot4", **SLOW), "witness": busybox(robot="robot6")}
    one.apply(services)

    def ends(robot: str) -> tuple[str, str]:
        (found,) = one.lab.inspect(robot, one.name_of("mover"))["NetworkSettings"]["Networks"].values()
        return found["IPAddress"], found["MacAddress"]

    address = ends("robot4")
    witness = one.lab.containers("robot6")
    since = one.now()
    services["mover"]["robot"] = "robot5"
    one.apply(services)
    assert one.lab.leftovers("robot4") == only_the_record("moves")
    assert ends("robot5") == address
    assert one.lab.containers("robot6") == witness
    died, started = one.times("robot4", since, "mover", "die"), one.times("robot5", since, "mover", "start")
    assert len(died) == len(started) == 1
    assert died[0] < started[0]
    for robot, service, other in (("robot6", "witness", "mover"), ("robot5", "mover", "witness")):
        ping = one.lab.shell(robot, "docker", "exec", one.name_of(service), "ping", "-c", "1", "-W", "2", other)
        assert " 0% packet loss" in ping.out


def test_two_services_change_places(trial: Any) -> None:
    """Pins that are swapped are no circle: both stop, both start on the other robot, each with its own address."""
    one = trial("swap", "robot7", "robot8")
    services = {"left": busybox(robot="robot7", **SLOW), "right": busybox(robot="robot8")}
    one.apply(services)
    since = one.now()
    services["left"]["robot"], services["right"]["robot"] = "robot8", "robot7"
    one.apply(services)
    assert list(one.lab.containers("robot7")) == [one.name_of("right")]
    assert list(one.lab.containers("robot8")) == [one.name_of("left")]
    story = sorted(event for robot in one.robots for event in one.events(robot, since))
    for service in services:
        times = [(action, when) for when, action, name in story if name == service and action in ("die", "start")]
        assert [action for action, _ in times] == ["die", "start"], times
    ping = one.lab.shell("robot8", "docker", "exec", one.name_of("left"), "ping", "-c", "1", "-W", "2", "right")
    assert " 0% packet loss" in ping.out


def test_services_wait_for_others_on_other_robots(trial: Any) -> None:
    """`healthy` waits for the health check's word, `completed` for the end of a job, across robots."""
    one = trial("order", "robot8", "robot9", "robot10", "robot11")
    check = {"test": ["CMD", "test", "-e", "/ready"], "interval": "1s", "timeout": "2s", "retries": 20}
    services = {
        "base": busybox("sh", "-c", "sleep 2; touch /ready; sleep 86400", robot="robot8", healthcheck=check),
        "calibrate": busybox("sleep", "2", robot="robot9"),
        "user": busybox(robot="robot10", depends_on={"base": {"condition": "healthy"}}),
        "drive": busybox(robot="robot11", depends_on={"calibrate": {"condition": "completed"}}),
    }
    since = one.now()
    one.apply(services)
    healthy = one.times("robot8", since, "base", "health_status: healthy")
    started = one.times("robot10", since, "user", "start")
    assert len(healthy) == len(started) == 1
    assert healthy[0] < started[0]
    job = one.state("robot9", "calibrate")
    assert (job["Status"], job["ExitCode"]) == ("exited", 0)
    assert job["FinishedAt"] < one.state("robot11", "drive")["StartedAt"]
    assert causes(one.run("plan", services).json) == {}, "a job that is done is right"


def test_what_needs_a_job_that_failed_is_skipped(trial: Any) -> None:
    """A job that ends with an error fails the run with 3; what waits for it is skipped and says why; others start."""
    one = trial("badjob", "robot1", "robot2", "robot3")
    services = {
        "calibrate": busybox("sh", "-c", "sleep 1; echo no chessboard in sight; exit 7", robot="robot1"),
        "drive": busybox(robot="robot2", depends_on={"calibrate": {"condition": "completed"}}),
        "other": busybox(robot="robot3"),
    }
    done = one.apply(services, "--settle", "1", code=3)
    outcome, message = one.outcome(done, "robot2", "drive")
    assert outcome == "skipped"
    assert "calibrate" in message and "exited with code 7" in message
    assert "drive" in done.err and "exited with code 7" in done.err
    assert one.name_of("drive") not in one.lab.containers("robot2")
    outcome, message = one.outcome(done, "robot1", "calibrate")
    assert outcome == "failed"
    assert "no chessboard in sight" in message
    assert (done.json["failed"], done.json["skipped"]) == (1, 1)
    assert one.state("robot3", "other")["Status"] == "running"


def test_a_service_that_dies_is_failed_with_its_last_words(trial: Any) -> None:
    """Whether at once or a second later: who does not stay up is failed, with log lines; the others keep running."""
    one = trial("dying", "robot4", "robot5", "robot6")
    services = {
        "stillborn": busybox("sh", "-c", "echo no camera on /dev/video0 >&2; exit 4", robot="robot4"),
        "shortlived": busybox("sh", "-c", "sleep 1; echo lost the lidar", robot="robot5"),
        "healthy": busybox(robot="robot6"),
    }
    done = one.apply(services, "--settle", "2", code=3)
    first, second = one.outcome(done, "robot4", "stillborn"), one.outcome(done, "robot5", "shortlived")
    assert first[0] == second[0] == "failed"
    assert "exited with code 4" in first[1] and "no camera on /dev/video0" in first[1]
    assert "exited with code 0" in second[1] and "lost the lidar" in second[1]
    assert "no camera on /dev/video0" in done.err and "lost the lidar" in done.err
    assert done.json["failed"] == 2
    assert one.outcome(done, "robot6", "healthy")[0] == "changed"
    assert one.state("robot6", "healthy")["Status"] == "running"
    assert one.state("robot4", "stillborn")["Status"] == "exited", "it can be looked at"


def test_network_modes_none_and_host(trial: Any) -> None:
    """`none` has no network, `host` has the robot's own and must be allowed; its name leads to the robot."""
    one = trial("modes", "robot7", "robot8", "robot9")
    services = {
        "apart": busybox(robot="robot7", network="none"),
        "bridge": busybox(robot="robot8", network="host"),
        "inner": busybox(robot="robot9"),
    }
    before = [one.lab.leftovers(robot) for robot in one.robots]
    refused = one.apply(services, code=9)
    assert "bridge: host-network" in refused.err and "--allow host-network" in refused.err
    assert [one.lab.leftovers(robot) for robot in one.robots] == before
    one.apply(services, "--allow", "host-network", "--settle", "0")

    def links(robot: str, service: str) -> set[str]:
        return set(one.lab.shell(robot, "docker", "exec", one.name_of(service), "ls", "/sys/class/net").out.split())

    def address(robot: str) -> str:
        return one.lab.shell(robot, "sh", "-c", "ip -4 -o addr show eth0 | sed 's/.*inet //; s,/.*,,'").out.strip()

    def namespace(robot: str, pid: int | str) -> str:
        return one.lab.shell(robot, "readlink", f"/proc/{pid}/ns/net").out.strip()

    assert links("robot7", "apart") == {"lo"}
    assert namespace("robot8", one.state("robot8", "bridge")["Pid"]) == namespace("robot8", 1)
    assert namespace("robot7", one.state("robot7", "apart")["Pid"]) != namespace("robot7", 1)
    ask = ("docker", "exec", one.name_of("inner"), "ping", "-c", "1", "-W", "2")
    assert f"PING bridge ({address('robot8')})" in one.lab.shell("robot9", *ask, "bridge").out
    assert "apart" not in one.named("robot9", "inner")
    after = [one.lab.leftovers(robot) for robot in one.robots]
    new = [sorted(set(now["networks"]) - set(then["networks"])) for now, then in zip(after, before, strict=True)]
    assert new == [[], [], ["srprov.modes"]], "only who is on the overlay has it"
    assert causes(one.run("plan", services).json) == {}


def test_a_service_leaves_the_overlay_and_comes_back(trial: Any) -> None:
    """The last service that leaves takes the robot's end of the network away, in one run; back it has its address."""
    one = trial("leave", "robot12", "robot13")
    services = {"left": busybox(robot="robot12"), "right": busybox(robot="robot13")}
    one.apply(services)
    there = one.lab.leftovers("robot13")
    ping = ("docker", "exec", one.name_of("left"), "ping", "-c", "1", "-W", "2", "right")
    first = one.lab.shell("robot12", *ping).out.splitlines()[0]
    services["right"]["network"] = "none"
    one.apply(services)
    alone = one.lab.leftovers("robot13")
    assert (alone["networks"], alone["links"]) == ([], [])
    assert alone["containers"] == there["containers"]
    assert causes(one.run("plan", services).json) == {}
    del services["right"]["network"]
    one.apply(services)
    assert one.lab.leftovers("robot13") == there
    assert one.lab.shell("robot12", *ping).out.splitlines()[0] == first
