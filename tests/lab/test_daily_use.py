"""Handling a running experiment: waiting for it, looking inside, stopping and starting parts of it."""

from __future__ import annotations

import fcntl
import os
import pty
import signal
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Iterator
from dataclasses import dataclass

import pytest

from tests.lab.conftest import BEGUN, ROOT, Done, Lab, busybox, edf, part_of_lab
from tests.lab.looks import begin, reached, wait_until

pytestmark = pytest.mark.lab

ROBOTS = ("robot1", "robot2", "robot3")
CHECK = {"test": ["CMD", "test", "-e", "/well"], "interval": "1s", "timeout": "2s", "retries": 2}
SERVICES = {
    "talker": busybox(
        "sh", "-c", "touch /well; sleep 1; echo ready after 1.5 s; trap 'exit 0' TERM; sleep 86400 & wait",
        robot="robot1", healthcheck=CHECK, stop_signal="SIGTERM",
    ),
    "worker": busybox("sh", "-c", "[ ! -e /slow ] || sleep 3", robot="robot2", job=True),
    "broken": busybox("sh", "-c", "sleep 5; exit 7", robot="robot2", job=True),
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

    def problems(self) -> dict[str, str]:
        """Give service -> what `status` calls wrong with it."""
        return {row["service"]: row["problem"] for row in self.run("status", "--json").json["services"]}


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
        "--wait-timeout", "200",
    )  # fmt: skip
    assert done.code == 0, done
    assert time.monotonic() - begun < 60
    first, *others = done.err.splitlines()
    assert first.startswith("waiting up to 200 s for completed:worker (worker on robot2); log:talker=^ready")
    assert {line.partition(" holds after")[0] for line in others} == {
        "completed:worker", r"log:talker=^ready after \d+", "healthy",
    }  # fmt: skip
    assert done.out == ""


def test_wait_ends_with_3_when_something_cannot_hold_any_more_or_the_time_is_over(running: Running) -> None:
    """A job that failed, a line that nobody can print now; and each is named."""
    hopeless = {
        "completed:broken": "completed:broken: broken on robot2 exited with code 7",
        "log:worker=never": "worker on robot2 exited with code 0 and has not printed it",
    }
    for until, words in hopeless.items():
        done = running.run("wait", "--until", until, "--wait-timeout", "60")
        assert done.code == 3 and "cannot hold any more" in done.err and words in done.err, done
    late = running.run("wait", "--until", "completed:drone", "--until", "log:talker=never", "--wait-timeout", "1")
    assert late.code == 3, late
    assert "not within 1 s: completed:drone: drone-1 on robot" in late.err and ", drone-2 on robot" in late.err
    assert "log:talker=never: talker on robot1 is running and has not printed it" in late.err


def test_wait_is_ended_by_ctrl_c(running: Running) -> None:
    """At once, with 130, also while a log is followed."""
    wait = begin(running.lab, "wait", *running.words, "--until", "log:talker=never")
    time.sleep(1.5)  # whatever it is at, it ends
    wait.send_signal(signal.SIGINT)
    begun = time.monotonic()
    _, said = wait.communicate(timeout=120)
    assert wait.returncode == 130 and "Traceback" not in said, said
    assert time.monotonic() - begun < 60


def test_exec_passes_words_streams_and_the_exit_code_on(running: Running) -> None:
    """As they are: no shell sees a word, standard output and error are apart, and input comes through in any bytes."""
    words = ("it's; $(reboot)", "two  blanks", "", "*", "-t", "ä\n")
    script = 'printf "%s|" "$@" "$SIZE" "$(id -u)" "$PWD"; echo on the other >&2; exit 7'
    done = running.run(
        "exec", "-e", "SIZE=a b=$c", "-u", "1000", "-w", "/tmp", "talker", "--", "sh", "-c", script, "sh", *words,
    )  # fmt: skip
    assert done.code == 7, done
    assert done.out == "|".join([*words, "a b=$c", "1000", "/tmp", ""])
    assert done.err == "on the other\n"
    text = "".join(f"line {number} ä\n" for number in range(40_000))
    back = running.run("exec", "drone-1", "--", "cat", stdin=text)
    assert (back.code, back.out == text, back.err) == (0, True, "")


def test_exec_ends_with_255_where_a_command_could_not_be_run(running: Running) -> None:
    """A container that has ended, a program that is not there, and a name of several containers."""
    cases = {
        ("worker",): "is not running",
        ("drone",): "that is more than one container: drone-1 on robot",
    }
    for (service,), words in cases.items():
        done = running.run("exec", service, "--", "true")
        assert done.code == 255 and words in done.err, done
    missing = running.run("exec", "talker", "--", "no-such-program")
    assert missing.code == 255 and "talker on robot1: the command could not be run" in missing.err, missing
    assert running.run("exec", "talker", "--", "sh", "-c", "exit 127").code == 127


class Terminal:
    """A terminal of 30 rows and 100 columns, and a program in it."""

    def __init__(self, lab: Lab, *words: str) -> None:
        self.end, other = pty.openpty()
        self.size(30, 100)
        self.shown = ""
        self.run = subprocess.Popen(
            ["setsid", "--ctty", sys.executable, "-m", "srprov", *words],
            cwd=lab.folder, env={**os.environ, "PYTHONPATH": str(ROOT)}, stdin=other, stdout=other, stderr=other,
            text=True,
        )  # fmt: skip
        BEGUN.append(self.run)
        os.close(other)
        os.set_blocking(self.end, False)

    def size(self, rows: int, columns: int) -> None:
        fcntl.ioctl(self.end, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))

    def says(self, keys: str, words: str) -> None:
        """Type keys, again and again until words are shown."""

        def look() -> bool:
            os.write(self.end, keys.encode())
            time.sleep(0.2)
            try:
                self.shown += os.read(self.end, 65536).decode()
            except BlockingIOError:
                return False
            except OSError as error:
                code = self.run.wait(timeout=30)
                raise AssertionError(f"it ended with {code} before {words!r}, and showed {self.shown!r}") from error
            return words in self.shown

        wait_until(look, 30, f"{words!r} after {keys!r} in {self.shown!r}")


def test_exec_lends_its_terminal(running: Running) -> None:
    """The command has a terminal of the same size, also when that changes; Ctrl-C ends what runs in it, not `exec`."""
    there = Terminal(running.lab, "exec", *running.words, "-t", "drone-1", "--", "sh")
    there.says("stty size\n", "30 100")
    there.size(40, 120)
    there.says("stty size\n", "40 120")
    there.says("echo it be''gins; sleep 1000\n", "it begins")
    # a shell that is about to start it may take the first Ctrl-C for its own prompt
    there.says("\x03echo still $((40 + 2))\n", "still 42")
    os.write(there.end, b"exit 5\n")
    assert there.run.wait(timeout=120) == 5
    os.close(there.end)


def test_an_apply_that_starts_a_job_says_so_and_none_starts_one_again_that_failed(running: Running) -> None:
    """The plan names it, with 2 for scripts; whoever wants it again says so."""
    (said,) = (line for line in running.applied.err.splitlines() if "is a job" in line and "worker" not in line)
    assert said.startswith("broken on robot2 is a job and was started; `srprov wait` with --until completed:broken ")
    lab, name = running.lab, "srprov.daily.broken"
    wait_until(lambda: lab.inspect("robot2", name)["State"]["Status"] == "exited", 30, "broken ends")
    before = lab.inspect("robot2", name)["State"]["StartedAt"]
    planned = running.run("plan", "--detailed-exitcode")
    assert planned.code == 2 and "Nothing to do" in planned.out, planned
    assert "note: broken on robot2 is a job that ended with code 7, and is left so" in planned.out
    assert running.run("apply", "--yes", "--settle", "0").code == 0
    assert lab.inspect("robot2", name)["State"]["StartedAt"] == before


def test_what_is_stopped_stays_stopped_until_somebody_starts_it(running: Running) -> None:
    """By its own signal, in the same container with the same address; locks, audit log and status tell the truth."""
    lab, name = running.lab, "srprov.daily.talker"
    before = lab.inspect("robot1", name)
    stopped = running.run("stop", "talker", "--yes", "--json")
    assert stopped.code == 0 and stopped.json["changed"] == 1, stopped
    state = lab.inspect("robot1", name)["State"]
    assert (state["Status"], state["ExitCode"]) == ("exited", 0), "SIGTERM reached it: it ends with 0"
    assert (
        "verb=stop instance=daily changed=1 failed=0" in lab.shell("robot1", "tail", "-n1", "/var/log/srprov.log").out
    )
    problems = running.problems()
    assert (problems["talker"], problems["drone-1"]) == ("stopped", "")
    assert f"~ #1 container {name}: exited with code 0" in running.run("plan").out
    refused = running.run("stop", "talker")
    assert refused.code == 9 and "--yes" in refused.err, refused

    done = lab.inspect("robot2", "srprov.daily.worker")["State"]["StartedAt"]
    started = running.run("start", "talker", "worker", "--yes", "--json")
    assert started.code == 0 and started.json["changed"] == 2, started
    job = lab.inspect("robot2", "srprov.daily.worker")["State"]
    assert (job["Status"], job["ExitCode"]) == ("exited", 0) and job["StartedAt"] != done, "a job that is named"
    after = lab.inspect("robot1", name)
    assert (after["Id"], after["State"]["Status"]) == (before["Id"], "running")
    networks = [one["NetworkSettings"]["Networks"]["srprov.daily"] for one in (before, after)]
    assert networks[0]["IPAddress"] == networks[1]["IPAddress"]
    assert reached(lab, lab_robot(lab, "drone-1"), "srprov.daily.drone-1", ["talker"]) == {"talker"}


def lab_robot(lab: Lab, service: str) -> str:
    """Give the robot that runs a service, by Docker's word."""
    return next(robot for robot in ROBOTS if f"srprov.daily.{service}" in lab.containers(robot))


def test_a_service_that_is_unhealthy_is_a_difference_and_a_restart_heals_it(running: Running) -> None:
    """No apply touches it: it runs, and perhaps for a reason."""
    lab, name = running.lab, "srprov.daily.talker"
    lab.shell("robot1", "docker", "exec", name, "rm", "/well")
    since = lab.inspect("robot1", name)["State"]["StartedAt"]

    def health() -> str:
        return str(lab.inspect("robot1", name)["State"]["Health"]["Status"])

    wait_until(lambda: health() == "unhealthy", 30, "it is unhealthy")
    assert running.problems()["talker"] == "unhealthy"
    planned = running.run("plan", "--detailed-exitcode")
    assert planned.code == 2 and "note: talker on robot1 is unhealthy, and is left so" in planned.out, planned
    assert lab.inspect("robot1", name)["State"]["StartedAt"] == since
    healed = running.run("restart", "talker", "--yes")
    assert healed.code == 0, healed
    assert lab.inspect("robot1", name)["State"]["StartedAt"] != since
    assert running.run("wait", "--until", "healthy:talker", "--wait-timeout", "30").code == 0


@pytest.mark.soak
def test_wait_outlasts_a_robot_that_is_cut_off_for_a_while(running: Running) -> None:
    """It says whom it awaits, and finds what was printed meanwhile."""
    lab = running.lab
    wait = begin(lab, "wait", *running.words, "--until", "log:talker=^later$", "--wait-timeout", "110")
    time.sleep(3)  # it has begun to follow the log
    assert lab.srprov("lab", "partition", "robot1").code == 0
    try:
        time.sleep(30)  # longer than a question waits for its answer
        lab.shell("robot1", "docker", "exec", "srprov.daily.talker", "sh", "-c", "echo later >/proc/1/fd/1")
    finally:
        assert lab.srprov("lab", "heal", "robot1").code == 0
    _, said = wait.communicate(timeout=120)
    assert wait.returncode == 0 and "waiting for robot1, up to 120 s: " in said, said
    assert "log:talker=^later$ holds after" in said
