"""The faults of the table in docs/reliability.md, each by the tests that show what comes of it."""

from __future__ import annotations

import time
from collections.abc import Callable
from itertools import groupby

from tests.lab.conftest import ROOT
from tools.soak.results import Result
from tools.soak.tests import Outcome, belongs, run

FILE_LIMIT_S = 1500.0
"""For the tests of one file, after which the lab is given back."""

_DISK = "test_faults.py::test_a_disk_that_takes_nothing_fails_its_robot_alone"
_BAD = "test_faults.py::test_what_works_on_a_bad_robot_is_done"

FAULTS: dict[str, tuple[str, ...]] = {
    "SIGKILL of the controller after a step of an apply": (
        "test_survival.py::test_a_killed_apply_is_finished_by_the_next",
    ),
    "SIGKILL of the controller during `--data move`, at any step or inside of the copy": (
        "test_data.py::test_data_is_moved_whole_also_when_the_move_was_killed_in_the_middle",
    ),
    "SIGKILL of the controller during a build": ("test_locks.py::test_a_killed_controller_leaves_no_lock",),
    "the network of a robot is cut during an apply": (
        "test_survival.py::test_a_robot_that_is_cut_off_in_the_middle_is_finished_later",
        "test_locks.py::test_a_cut_network_leaves_no_lock",
    ),
    "SIGKILL of a robot's dockerd during an apply": (
        "test_survival.py::test_an_engine_that_crashes_in_the_middle_is_finished_later",
    ),
    "SIGKILL of a robot's dockerd while it starts a container": (
        "test_survival.py::test_an_engine_that_dies_while_it_starts_a_container_is_finished_later",
    ),
    "SIGKILL of a robot's dockerd during a build": (
        "test_survival.py::test_what_a_killed_build_leaves_is_removed_by_whoever_comes_next",
    ),
    "a robot loses power during an apply, or is off": (
        "test_failures.py::test_robots_that_cannot_be_reached_are_named_and_the_others_done",
        "test_failures.py::test_a_service_does_not_start_before_one_whose_robot_is_gone",
        "test_failures.py::test_a_robot_that_dies_in_the_middle_is_a_result_and_not_the_end",
    ),
    "the disk for Docker is full": (
        f"{_DISK}[robot1-no space left on device]",
        "test_faults.py::test_room_on_the_disk_is_all_that_was_missing",
    ),
    "the disk for Docker is read-only": (f"{_DISK}[robot2-read-only file system]",),
    "`MaxSessions 1`": ("test_faults.py::test_a_robot_with_one_session_is_not_used_and_says_why",),
    "`MaxSessions 3`": (f"{_BAD}[robot8]",),
    "`MaxStartups 2`, both taken by others": (
        f"{_BAD}[robot3]",
        "test_faults.py::test_an_sshd_whose_startups_are_taken_is_unreachable_until_they_are_free",
    ),
    "a `.bashrc` that prints, also what is not UTF-8, also without a newline": (f"{_BAD}[robot5]",),
    "5 % of the packets lost each way": (f"{_BAD}[robot6]",),
    "a link of 2 Mbit/s": (f"{_BAD}[robot7]",),
    "a host key changed": ("test_failures.py::test_a_changed_host_key_stops_everything_on_that_robot",),
    "an image that does not exist, a service that ends at once": (
        "test_failures.py::test_a_step_that_fails_stops_what_needs_it_and_nothing_else",
        "test_failures.py::test_a_service_that_dies_in_its_first_breath_is_a_failure",
    ),
}
"""Fault, as the table names it -> tests."""


def path_of(test: str) -> str:
    return f"tests/lab/{test}"


def in_order() -> list[tuple[str, list[str]]]:
    """Return each file's tests as they stand there: some build on what others left."""
    every = [path_of(test) for tests in FAULTS.values() for test in tests]

    def place(test: str) -> tuple[str, int]:
        file, _, name = test.partition("::")
        return file, (ROOT / file).read_text(encoding="utf-8").index(f"\ndef {name.partition('[')[0]}(")

    ordered = sorted(every, key=place)
    return [(file, list(tests)) for file, tests in groupby(ordered, lambda test: test.partition("::")[0])]


def soak(wait_s: float, tell: Callable[[Result], None]) -> bool:
    """Run them file by file, with the lab given back in between; whether all passed."""
    outcomes: list[Outcome] = []
    seconds, files = 0.0, in_order()
    for number, (_, tests) in enumerate(files, 1):
        found, took = run(tests, FILE_LIMIT_S, wait_s)
        outcomes, seconds = outcomes + found, seconds + took
        result = told(outcomes, seconds, sum(len(later) for _, later in files[number:]))
        tell(result)
        time.sleep(1)  # whoever waits for the lab has it now
    return result.fine


def told(outcomes: list[Outcome], seconds: float, left: int) -> Result:
    """Return the figures, and each fault's tests by name."""
    rows, whole, seen = [], 0, 0
    for fault, tests in FAULTS.items():
        mine = [one for one in outcomes if any(belongs(one.test, path_of(test)) for test in tests)]
        rows += [one.row(fault) for one in mine]
        seen += bool(mine)
        whole += bool(mine) and all(one.fine for one in mine)
    passed = sum(one.fine for one in outcomes)
    return Result(
        "faults",
        "Every fault of the table in docs/reliability.md, by the lab tests that show what comes of it.",
        [f"{whole} of {len(FAULTS)} faults: all their tests passed", f"{passed} of {len(outcomes)} tests passed"],
        ["| fault | test | took | end |", "|---|---|---|---|", *rows],
        seconds,
        left,
        max(len(outcomes) - passed, seen - whole),
    )
