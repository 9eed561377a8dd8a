"""Output that cannot be written: the run does what it has to do on the robots, and the exit code says what is lost."""

from __future__ import annotations

import fcntl
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[3]
EDF = """\
edf: 1
name: hello
services:
  a: {image: busybox}
  b: {image: busybox, depends_on: [a]}
"""
INVENTORY = "all: {hosts: {r1: {ansible_host: 10.0.0.1}, r2: {ansible_host: 10.0.0.2}}}\n"
DISK_FULL = "standard output cannot be written: No space left on device"
APPLY = ("apply", "e.edf", "-i", "inv.yml", "--yes", "--settle", "0")
BOTH = [["a", "r1"], ["b", "r2"]]
LIMIT_S = 60


class Place:
    """A folder with an experiment, and `srprov` there with robots in memory."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / "e.edf").write_text(EDF)
        (folder / "inv.yml").write_text(INVENTORY)

    def run(self, *words: str, shell: str = "", fault: int = 0, **options: Any) -> subprocess.CompletedProcess[str]:
        """Run one command line. `shell` stands behind it, e.g. `>&-`; `fault` is the command that a robot refuses."""
        command = [sys.executable, "-m", "tests.unit.cli.faked", *words]
        if shell:
            command = ["sh", "-c", f'"$@" {shell}', "sh", *command]
        streams: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "stdin": subprocess.DEVNULL}
        env = {**os.environ, "PYTHONPATH": str(ROOT), "HOME": str(self.folder), "FAKED_STATE": "running.json"}
        env["FAKED_FAULT"] = str(fault or "")
        return subprocess.run(
            command, cwd=self.folder, env=env, text=True, timeout=LIMIT_S, check=False, **{**streams, **options}
        )

    def running(self) -> Any:
        """Return what ran on the robots when the last command ended."""
        return json.loads((self.folder / "running.json").read_text())


@pytest.fixture
def place(tmp_path: Path) -> Place:
    return Place(tmp_path)


def nobody_reads() -> int:
    """Return the end for writing of a pipe whose reader has gone."""
    reader, writer = os.pipe()
    os.close(reader)
    return writer


def test_an_apply_goes_on_when_nobody_reads_it(place: Place) -> None:
    """As with `srprov apply … 2>&1 | head -1`."""
    gone = nobody_reads()
    assert place.run(*APPLY, stdout=gone, stderr=gone).returncode == 0
    assert place.running() == BOTH


def test_an_apply_goes_on_without_a_place_for_its_words(place: Place) -> None:
    with open("/dev/full", "w") as full:
        done = place.run(*APPLY, stdout=full)
        assert done.returncode == 0 and place.running() == BOTH
        assert [line for line in done.stderr.splitlines() if "cannot" in line] == [f"warning: {DISK_FULL}"]
        assert place.run(*APPLY, stdout=full, stderr=full).returncode == 0
        assert place.running() == BOTH


def test_a_run_keeps_its_own_exit_code(place: Place) -> None:
    """3 for a failed step is more than a lost report."""
    with open("/dev/full", "w") as full:
        done = place.run(*APPLY, "--json", stdout=full, fault=4)
    assert done.returncode == 3, done.stderr
    assert f"error[SRP-221]: {DISK_FULL}" in done.stderr


@pytest.mark.parametrize("gone", [True, False], ids=["nobody reads", "disk full"])
def test_a_report_that_is_lost_is_no_success(place: Place, gone: bool) -> None:
    """The robots were changed all the same; where the reader has left, nothing more is said."""
    stream = nobody_reads() if gone else os.open("/dev/full", os.O_WRONLY)
    done = place.run(*APPLY, "--json", "--quiet", stdout=stream)
    assert done.returncode == 5 and place.running() == BOTH
    assert (DISK_FULL in done.stderr) is not gone
    assert place.run("facts", "-i", "inv.yml", "--json", stdout=stream).returncode == 5


@pytest.mark.parametrize("verb", [["facts", "-i", "inv.yml"], ["--help"]], ids=" ".join)
def test_a_reader_that_leaves_ends_a_reading_verb_quietly(place: Place, verb: list[str]) -> None:
    """As with `srprov facts | head -1`: no word, and the verb's own exit code."""
    done = place.run(*verb, stdout=nobody_reads())
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("verb", [["facts", "-i", "inv.yml"], ["--help"]], ids=" ".join)
def test_an_answer_that_does_not_fit_on_the_disk_is_an_error(place: Place, verb: list[str]) -> None:
    with open("/dev/full", "w") as full:
        done = place.run(*verb, stdout=full)
    assert (done.returncode, done.stderr) == (5, f"error[SRP-221]: {DISK_FULL}\n")


def test_streams_may_be_closed_from_the_beginning(place: Place) -> None:
    """Their numbers must not become those of connections: somebody would write into them."""
    assert place.run("facts", "-i", "inv.yml", "--json", shell=">&-").returncode == 5
    assert place.run(*APPLY, shell="<&- >&- 2>&-").returncode == 0
    assert place.running() == BOTH
    done = place.run("apply", "e.edf", "-i", "inv.yml", shell="<&-")
    assert done.returncode == 9 and "no terminal to ask on" in done.stderr


def test_a_stream_that_does_not_wait_is_waited_for(place: Place) -> None:
    """Whoever shares a pipe or terminal may have made it so; more than the pipe holds is still written."""
    services = "".join(f"  s{number:03}: {{image: busybox}}\n" for number in range(300))
    (place.folder / "e.edf").write_text(
        f"edf: 1\nname: hello\nplacement: {{slots_per_robot: 200}}\nservices:\n{services}"
    )
    reader, writer = os.pipe()
    fcntl.fcntl(writer, fcntl.F_SETPIPE_SZ, 4096)
    os.set_blocking(writer, False)
    slow = "import sys, time; time.sleep(1); print(len(sys.stdin.read().splitlines()))"
    counting = subprocess.Popen([sys.executable, "-c", slow], stdin=reader, stdout=subprocess.PIPE, text=True)
    os.close(reader)
    done = place.run("plan", "e.edf", "-i", "inv.yml", stdout=writer)
    os.close(writer)
    assert (done.returncode, done.stderr) == (0, "")
    assert int(counting.communicate(timeout=LIMIT_S)[0]) > 600


def test_events_that_do_not_fit_on_the_disk_are_told_of_once(place: Place) -> None:
    done = place.run(*APPLY, "--events", "/dev/full", "-q")
    assert done.returncode == 0 and place.running() == BOTH
    lines = done.stderr.splitlines()
    assert lines[0] == "warning: no more events are written to /dev/full: No space left on device"
    assert len(lines) == 2 and lines[1].startswith("hello: done in ")


@pytest.mark.parametrize(
    "words",
    [
        [*APPLY, "--events", "no/folder/x"],
        ["destroy", *APPLY[1:5], "--events", "."],
        ["plan", *APPLY[1:4], "-o", "no/x"],
    ],
)
def test_a_file_that_cannot_be_opened_is_refused_before_a_robot_is_asked(place: Place, words: list[str]) -> None:
    done = place.run(*words)
    assert (
        done.returncode == 5
        and f"error[SRP-221]: --{'out' if words[-2] == '-o' else 'events'}: cannot write" in done.stderr
    )
    assert "asking" not in done.stderr and "Traceback" not in done.stderr
    assert not (place.folder / ".local").exists(), "a run was recorded"


def test_a_plan_that_does_not_fit_on_the_disk_is_an_error(place: Place) -> None:
    done = place.run("plan", "e.edf", "-i", "inv.yml", "-o", "/dev/full")
    assert (done.returncode, done.stdout) == (5, "")
    assert done.stderr == "error[SRP-221]: cannot write /dev/full: No space left on device\n  name another file\n"


def test_a_refused_plan_leaves_its_file_as_it_was(place: Place) -> None:
    """Whether it can be written is looked at first; that must neither make nor empty it."""
    (place.folder / "e.edf").write_text(EDF + "    robot: nobody\n")
    (place.folder / "old.json").write_text("old")
    for name in ("old.json", "new.json"):
        assert place.run("plan", "e.edf", "-i", "inv.yml", "-o", name).returncode == 5
    assert (place.folder / "old.json").read_text() == "old" and not (place.folder / "new.json").exists()


def test_quiet_leaves_warnings_errors_and_the_last_line(place: Place) -> None:
    done = place.run(*APPLY, "--quiet")
    assert (done.returncode, done.stdout) == (0, "")
    assert len(done.stderr.splitlines()) == 1 and done.stderr.startswith("hello: done in ")
    loud = place.run(*APPLY)
    assert loud.stdout and loud.stderr.startswith("asking 2 robots for facts\n[1/") and loud.stderr.count("\n") > 10
    failed = place.run(*APPLY, "--quiet", fault=4)
    assert failed.returncode == 3 and failed.stdout == ""
    assert failed.stderr.startswith("failed: #") and " [SRP-607]\n" in failed.stderr and "\nskipped: #" in failed.stderr
    assert failed.stderr.splitlines()[-1].startswith("hello: done in ")
