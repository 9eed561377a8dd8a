"""A controller that is killed at any line of a run's journal, and gone on with: as if nothing had been."""

from __future__ import annotations

import csv
import os
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.lab.conftest import COMMAND_LIMIT_S, ROOT, Lab, busybox, edf
from tests.lab.test_trials import RACER, REFEREE, SETTINGS, Race

pytestmark = pytest.mark.lab

LINES = 18
"""Of the journal of an undisturbed run: its begin and its end, and eight events of each of two trials."""
TIMES = {
    *("attempt", "adopted", "started_utc", "ready_s", "duration_s", "stop_s", "collect_s", "start_skew_ms"),
    *("start_skew_error_ms", "clock_max_offset_ms", "clock_error_ms", "clock_step", "controller_gap_s", "m_ticks"),
}
"""Columns that may differ: times, and what a service printed meanwhile."""


def small() -> str:
    """Return an EDF with three services, one of which runs until it is stopped, and two trials of half a second."""
    return edf(
        "small",
        {
            "racer": busybox("sh", "-c", RACER, robot="robot1"),
            "timer": busybox("sleep", "0.2", robot="robot2"),
            "referee": busybox("sh", "-c", REFEREE, robot="robot2"),
        },
        parameters={"SPEED": {"values": [0.5], "apply_to": "racer"}, "CODE": [0, 3]},
        trials={**SETTINGS, "repetitions": 1},
        placement={"slots_per_robot": 2},
        results={"racer": ["/out/result.json"]},
        metrics={
            "time": {"service": "racer", "json": "/out/result.json#/time", "unit": "s"},
            "ticks": {"service": "referee", "log": "^tick", "reduce": "count"},
        },
    )


def told(rows: list[dict[str, str]]) -> list[dict[str, str]]:
    """Return what must be the same however often a run was disturbed."""
    counted = [row for row in rows if row["status"] != "interrupted"]
    return sorted(({name: row[name] for name in row if name not in TIMES} for row in counted), key=lambda r: r["trial"])


@dataclass(frozen=True)
class Calm:
    """An undisturbed run: its files, its table, and how many lines its journal has."""

    folder: Path
    rows: list[dict[str, str]]
    lines: int


@pytest.fixture(scope="module")
def calm(lab_of_module: Lab, tmp_path_factory: pytest.TempPathFactory) -> Calm:
    one = Race(lab_of_module, folder := tmp_path_factory.mktemp("calm"), small())
    done = one.run()
    assert done.code == 0, done
    assert len(one.rows()) == 2 and one.left() == set()
    return Calm(folder, one.rows(), len(one.events()))


def killed(race: Race, line: int, part: str, *more: str) -> None:
    """Run it with a controller that kills itself at that line, counted from where it begins."""
    program = [sys.executable, "-m", "tests.lab.killed", str(line), part, *race.words, *more]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        program, cwd=race.lab.folder, env=environment, stdin=subprocess.DEVNULL, capture_output=True,
        timeout=COMMAND_LIMIT_S, check=False,
    )  # fmt: skip
    assert done.returncode == -signal.SIGKILL, done


@pytest.mark.soak
@pytest.mark.parametrize("line", range(1, LINES + 1))
@pytest.mark.parametrize("part", ["torn", "whole"])
def test_a_controller_killed_at_any_line_of_its_journal(
    lab_of_module: Lab, calm: Calm, tmp_path: Path, line: int, part: str
) -> None:
    """`--resume` gives the undisturbed run's table, runs nothing twice that had ended, and leaves nothing on robots."""
    assert calm.lines == LINES
    one = Race(lab_of_module, calm.folder, small())
    one.home = tmp_path / "run"
    killed(one, line, part)
    journal = (one.home / "journal.jsonl").read_bytes()
    assert journal.endswith(b"\n") is (part == "whole")
    if (line, part) == (1, "torn"):
        assert one.run("--resume").code == 5, "no event, no run"
        return
    before = one.events()
    again = one.run("--resume")
    assert again.code == 0, again
    assert told(one.rows()) == told(calm.rows)
    with (one.home / "trials.csv").open(newline="") as stream:
        assert len(list(csv.DictReader(stream))) == len(one.rows())
    assert one.left() == set()
    begun = [(event["trial"], event["attempt"]) for event in one.events() if event["event"] == "begin"]
    assert len(begun) == len(set(begun))
    for trial in safe(before):
        assert sum(name == trial for name, _ in begun) == 1, "what was at home is not run again"


def safe(events: list[dict[str, Any]]) -> set[str]:
    """Return the trials whose data were at home."""
    return {event["trial"] for event in events if event["event"] in ("collected", "end")}
