"""Handling a running experiment: waiting for it, looking inside, stopping and starting parts of it."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator
from dataclasses import dataclass

import pytest

from tests.lab.conftest import Done, Lab, busybox, edf, part_of_lab
from tests.lab.looks import begin

pytestmark = pytest.mark.lab

ROBOTS = ("robot1", "robot2", "robot3")
CHECK = {"test": ["CMD", "test", "-e", "/well"], "interval": "1s", "timeout": "2s", "retries": 2}
SERVICES = {
    "talker": busybox(
        "sh", "-c", "touch /well; sleep 1; echo ready after 1.5 s; trap 'exit 0' TERM; sleep 86400 & wait",
        robot="robot1", healthcheck=CHECK, stop_signal="SIGTERM",
    ),
    "worker": busybox("sh", "-c", "[ ! -e /slow ] || sleep 3", robot="robot2", job=True),
    "broken": busybox("sh", "-c", "sleep 2; exit 7", robot="robot2", job=True),
    "drone": busybox(replicas=2, requires={"tags": ["flying"]}),
}  # fmt: skip


@dataclass
class Running:
    """An experiment that was applied once for all tests of this file."""

    lab: Lab
    words: tuple[str, ...]
    applied: Done

    def run(self, verb: str, *more: str, **options: str) -> Done:
        """Run a verb on it."""
        return self.lab.srprov(verb, *self.words, *more, **options)


@pytest.fixture(scope="module")
def running(lab_of_module: Lab, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """Give the experiment."""
    lab, folder = lab_of_module, tmp_path_factory.mktemp("daily")
    path = folder / "daily.edf"
    path.write_text(edf("daily", SERVICES), encoding="utf-8")
    more = {robot: {"srprov_tags": ["flying"], "srprov_slots": 3} for robot in ROBOTS}
    words = (str(path), "-i", part_of_lab(lab, ROBOTS, folder / "lab.yml", **more))
    applied = lab.srprov("apply", *words, "--yes", "--settle", "0")
    assert applied.code == 0, applied
    yield Running(lab, words, applied)
    assert lab.srprov("destroy", *words, "--yes").code == 0


def test_wait_ends_when_all_that_is_awaited_holds(running: Running) -> None:
    """A job that is done, a line that was printed, every healthcheck, all replicas; said at once, and when it holds."""
    begun = time.monotonic()
    done = running.run(
        "wait", "--until", "completed:worker", "--until", r"log:talker=^ready after \d+", "--until", "healthy",
        "--wait-timeout", "60",
    )  # fmt: skip
    assert done.code == 0, done
    assert time.monotonic() - begun < 15
    first, *others = done.err.splitlines()
    assert first.startswith("waiting up to 60 s for completed:worker (worker on robot2); log:talker=^ready")
    assert {line.partition(" holds after")[0] for line in others} == {
        "completed:worker", r"log:talker=^ready after \d+", "healthy",
    }  # fmt: skip
    assert done.out == ""


def test_wait_ends_with_3_when_something_cannot_hold_any_more_or_the_time_is_over(running: Running) -> None:
    """A job that failed, a service without a healthcheck, a line that nobody can print now; and each is named."""
    hopeless = {
        "completed:broken": "completed:broken: broken on robot2 exited with code 7",
        "healthy:drone-1": "has no healthcheck",
        "log:worker=never": "worker on robot2 exited with code 0 and has not printed it",
    }
    for until, words in hopeless.items():
        done = running.run("wait", "--until", until, "--wait-timeout", "60")
        assert done.code == 3 and "cannot hold any more" in done.err and words in done.err, done
    late = running.run("wait", "--until", "completed:drone", "--until", "log:talker=never", "--wait-timeout", "1")
    assert late.code == 3, late
    assert "not within 1 s: completed:drone: drone-1 on robot" in late.err and ", drone-2 on robot" in late.err
    assert "log:talker=never: talker on robot1 is running and has not printed it" in late.err
    wrong = running.run("wait", "--until", "completed:nobody")
    assert wrong.code == 5 and "daily has no nobody" in wrong.err, wrong


def test_wait_is_ended_by_ctrl_c(running: Running) -> None:
    """At once, with 130, also while a log is followed."""
    wait = begin(running.lab, "wait", *running.words, "--until", "log:talker=never")
    time.sleep(1.5)  # whatever it is at, it ends
    wait.send_signal(signal.SIGINT)
    begun = time.monotonic()
    _, said = wait.communicate(timeout=30)
    assert wait.returncode == 130 and "Traceback" not in said, said
    assert time.monotonic() - begun < 3
