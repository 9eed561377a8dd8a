"""Clocks in trials, set wrong on purpose: the truth lies within the bound that is stated, and steps are seen."""

from __future__ import annotations

import csv
import json
import re
import statistics
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.lab.conftest import ROBOTS, Lab, busybox, edf, part_of_lab
from tests.lab.looks import begin, wait_until

pytestmark = pytest.mark.lab


def set_clock(lab: Lab, robot: str, offset_s: float) -> None:
    done = lab.srprov("lab", "clock", robot, "--offset", str(offset_s))
    assert done.code == 0, done


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


def events(home: Path) -> list[str]:
    journal = home / "journal.jsonl"
    lines = journal.read_text().split("\n")[:-1] if journal.exists() else []
    return [json.loads(line)["event"] for line in lines]


def prepare(lab: Lab, folder: Path, robots: tuple[str, ...], seconds: float, **trials: Any) -> tuple[str, ...]:
    """Write an experiment with a service on each robot that runs for so long; return the words that run it."""
    services = {f"on_{robot}": busybox("sleep", str(seconds), robot=robot) for robot in robots}
    (folder / "clocks.edf").write_text(edf("clocks", services, trials={"timeout": "20s", **trials}))
    return ("run", str(folder / "clocks.edf"), "-i", part_of_lab(lab, robots, folder / "inventory.yml"), "--yes", "-o")


def check_bounds(home: Path, truth: dict[tuple[str, str], float]) -> list[float]:
    """Compare every measurement with the truth, (robot, when) -> seconds; return the bounds in ms."""
    found = rows(home / "clocks.csv")
    assert {(one["robot"], one["when"]) for one in found} == set(truth)
    for one in found:
        true_ms = 1000 * truth[one["robot"], one["when"]]
        assert abs(float(one["offset_ms"]) - true_ms) <= float(one["error_ms"]), (one, true_ms)
        assert float(one["error_ms"]) <= float(one["rtt_ms"]) / 2 + 1e-5, one
    return [float(one["error_ms"]) for one in found]


CHRONYC = """#!/bin/sh
echo C0A80101,192.168.1.1,3,1795338000.1,-0.000123,0.000045,0.0002,-12.3,0.002,0.05,0.0042,0.0010,64.2,Normal
"""


@pytest.fixture
def chrony(lab: Lab) -> Iterator[Lab]:
    """Give the lab with a chronyc on robot1."""
    path = "/usr/local/bin/chronyc"
    lab.shell("robot1", "sh", "-c", 'printf %s "$1" >"$0" && chmod +x "$0"', path, CHRONYC)
    yield lab
    lab.shell("robot1", "rm", path)


def test_what_keeps_a_clock_is_said(chrony: Lab, tmp_path: Path) -> None:
    set_clock(chrony, "robot2", -0.75)
    *words, _, _ = prepare(chrony, tmp_path, ("robot1", "robot2"), 0.1)
    assert words[2] == "-i"
    done = chrony.srprov("doctor", *words[2:4], "--json")
    assert done.code == 0, done
    found = {
        robot: one["found"] for robot, some in done.json["robots"].items() for one in some if one["check"] == "clock"
    }
    assert found["robot1"].endswith(" ms) from the controller; chrony: synchronised, within 3.2 ms of its source"), (
        found
    )
    assert found["robot2"].startswith("-75") or found["robot2"].startswith("-74"), found
    assert found["robot2"].endswith("; nothing known keeps it"), found


def test_a_clock_that_is_set_in_a_trial_is_seen_and_one_that_is_off_is_waited_for(chrony: Lab, tmp_path: Path) -> None:
    robots = ("robot1", "robot2")
    set_clock(chrony, "robot1", -1.25)
    set_clock(chrony, "robot2", 2.0)
    words = prepare(
        chrony, tmp_path, robots, 1.2, limits={"clock_offset": "1.9s", "battery": 5, "wait": "60s"}, retries=0
    )
    home = tmp_path / "run"
    running = begin(chrony, *words, str(home))
    wait_until(lambda: "begin" in events(home), 60, "the trial")
    wait_until(
        lambda: chrony.srprov("lab", "status", "--json").json["robots"]["robot2"]["faults"] == ["clock +2 s"], 5, ""
    )
    assert chrony.containers("robot1") == {}, "nothing is made meanwhile"
    set_clock(chrony, "robot2", 1.75)
    wait_until(lambda: "ready" in events(home), 60, "the clock is right enough")
    set_clock(chrony, "robot2", -0.5)
    _, said = running.communicate(timeout=120)
    assert running.returncode == 0, said
    assert "waiting up to 60 s: robot2: its clock is 2.0 s off (+-" in said and "and may be 1.9 s" in said, said
    assert said.count("cannot tell: robot1: it does not say how much is left in its battery") == 1, said
    before = {("robot1", "before"): -1.25, ("robot2", "before"): 1.75}
    check_bounds(home, {**before, ("robot1", "after"): -1.25, ("robot2", "after"): -0.5})
    kept = {
        one["robot"]: (one["kept_by"], one["synchronised"], one["sync_bound_ms"]) for one in rows(home / "clocks.csv")
    }
    assert kept == {"robot1": ("chrony", "true", "3.223"), "robot2": ("", "", "")}
    (row,) = rows(home / "trials.csv")
    assert (row["status"], row["clock_step"]) == ("ok", "true"), "the clock of one robot was set"

    words = prepare(
        chrony, tmp_path, robots, 0.1, limits={"clock_offset": "1s", "disk_free": "900000g", "wait": "0"}, retries=0
    )
    refused = chrony.srprov(*words, str(tmp_path / "other"))
    assert refused.code == 3, refused
    (row,) = rows(tmp_path / "other" / "trials.csv")
    assert row["status"] == "infrastructure" and row["reason"].startswith(
        ("robot1: its clock is 1.2", "robot1: its clock is 1.3")
    ), row  # 1.25
    free = int(chrony.shell("robot1", "df", "-Pm", "/var/lib/docker").out.splitlines()[1].split()[3])
    told = re.search(r"robot1: ([0-9]+) MiB of its disk are free, and 921600000 MiB are wanted", row["reason"])
    assert told and int(told[1]) == pytest.approx(free, rel=0.02), (row, free)
    assert "created" not in events(tmp_path / "other"), "it was not begun"
    assert row["clock_max_offset_ms"] == "", row


SPEC = """\
robots:
  robot2: {ssh_latency_ms: {to: 40, from: 0}}
  robot3: {ssh_latency_ms: {to: 0, from: 25}}
  robot4: {ssh_latency_ms: {to: 3, from: 12}, rate_mbit: 2}
"""
OFFSETS = (-2.0, -1.3, -0.25, -0.02, -0.001, 0.0, 0.001, 0.02, 0.25, 1.3, 2.0)


@pytest.mark.soak
def test_every_offset_lies_within_its_bound_also_over_uneven_paths(
    lab: Lab, tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    """Offsets from -2 s to 2 s, each of four robots another, each stepped in the trial: 88 measurements."""
    (tmp_path / "lab-spec.yml").write_text(SPEC)
    done = lab.srprov("lab", "up", "-n", str(ROBOTS), "--spec", str(tmp_path / "lab-spec.yml"))
    assert done.code == 0, done
    robots = ("robot1", "robot2", "robot3", "robot4")
    bounds: dict[str, list[float]] = {robot: [] for robot in robots}
    for at in range(len(OFFSETS)):
        truth = {}
        for place, robot in enumerate(robots):
            truth[robot, "before"] = OFFSETS[(at + place) % len(OFFSETS)]
            truth[robot, "after"] = OFFSETS[(at + place + 5) % len(OFFSETS)]
            set_clock(lab, robot, truth[robot, "before"])
        words = prepare(lab, tmp_path, robots, 4)
        home = tmp_path / f"run{at}"
        running = begin(lab, *words, str(home))
        wait_until(lambda home=home: "ready" in events(home), 90, "the trial")  # type: ignore[misc]  # bound at once
        for robot in robots:
            set_clock(lab, robot, truth[robot, "after"])
        _, said = running.communicate(timeout=120)
        assert running.returncode == 0, said
        check_bounds(home, truth)
        for one in rows(home / "clocks.csv"):
            bounds[one["robot"]].append(float(one["error_ms"]))
        (row,) = rows(home / "trials.csv")
        assert row["clock_step"] == "true", row
    found = {robot: (len(some), min(some), statistics.median(some), max(some)) for robot, some in bounds.items()}
    record_property("bounds", found)
    assert {robot: count for robot, (count, *_) in found.items()} == dict.fromkeys(robots, 2 * len(OFFSETS))
    assert found["robot2"][1] >= 20 and found["robot3"][1] >= 12.5, "half of what a round trip takes"
