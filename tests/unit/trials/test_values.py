"""Readings, clocks, metrics, rows and tables of trials, from values."""

from __future__ import annotations

import csv
import io
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from srprov.definitions.trialsmodel import Metric, Parameter, TrialDefinitions
from srprov.linear_regex import compiled
from srprov.trials import Trial, design
from srprov.trials.clock import Offset, Sample, offset, stepped
from srprov.trials.judge import End
from srprov.trials.metrics import Scanned, from_json, scan
from srprov.trials.reading import Reading, engine_time, read
from srprov.trials.row import Seen, row
from srprov.trials.table import columns, csv_text
from tests.bounded import bounded

INSPECTED = {
    "Image": "sha256:1",
    "RestartCount": 2,
    "State": {
        "Status": "exited",
        "ExitCode": 3,
        "OOMKilled": True,
        "StartedAt": "2026-11-22T09:00:00.123456789Z",
        "FinishedAt": "2026-11-22T11:00:01.5+02:00",
        "Health": {"Status": "unhealthy"},
        "Error": "no",
    },
}


def test_a_container_is_read_from_what_the_engine_says() -> None:
    assert read(INSPECTED) == Reading(
        state="exited", exit_code=3, health="unhealthy", oom=True, restarts=2, image="sha256:1", error="no",
        started=1795338000.123456789, finished=1795338001.5,
    )  # fmt: skip


@pytest.mark.parametrize("answer", [None, [], {}, {"State": 3}, {"State": {}}, "x"])
def test_what_is_no_container_is_none(answer: object) -> None:
    assert read(answer) == Reading(state="")


@pytest.mark.parametrize("text", ["", "0001-01-01T00:00:00Z", "yesterday", "2026-13-01T00:00:00Z", "9" * 400])
def test_what_is_no_time_is_never(text: str) -> None:
    assert engine_time(text) == 0.0


@given(
    st.floats(-5, 5), st.lists(st.tuples(st.floats(0, 0.5), st.floats(0, 0.5)), min_size=1, max_size=16), st.booleans()
)
def test_the_true_offset_lies_within_the_bound(true: float, ways: list[tuple[float, float]], coarse: bool) -> None:
    """However different the ways there and back are; also for a robot that tells whole seconds."""
    samples = []
    for number, (there, back) in enumerate(ways):
        asked = 1000.0 + number
        robot = asked + there + true
        told = float(int(robot)) if coarse else robot
        samples.append(
            Sample(asked=asked, robot=told, answered=asked + there + back, resolution=1.0 if coarse else 0.0)
        )
    found = offset(samples)
    assert found is not None
    assert abs(found.offset_s - true) <= found.error_s + 1e-9
    assert found.rtt_s <= min(there + back for there, back in ways) + 1e-9 or coarse


def test_without_samples_no_offset_is_known() -> None:
    assert offset([]) is None


@pytest.mark.parametrize(("moved", "expected"), [(0.0, False), (0.009, False), (0.02, True), (-0.5, True)])
def test_a_step_is_more_than_errors_and_drift(moved: float, expected: bool) -> None:
    before = Offset(offset_s=1.0, error_s=0.002, rtt_s=0.004, samples=16)
    after = Offset(offset_s=1.0 + moved, error_s=0.003, rtt_s=0.006, samples=16)
    assert stepped(before, after, 10.0) is expected


@pytest.mark.parametrize(
    ("text", "pointer", "expected"),
    [
        ('{"time": 12.5}', "/time", 12.5),
        ("12", "", 12.0),
        ('{"a": [1, {"b/c": {"~": true}}]}', "/a/1/b~1c/~0", 1.0),
        ('{"a": "12"}', "/a", None),
        ('{"a": [1]}', "/a/1", None),
        ('{"a": [1]}', "/a/-1", None),
        ('{"a": NaN}', "/a", None),
        ('{"a": 1e999}', "/a", None),
        ("[" * 5000, "", None),
        ("", "/a", None),
    ],
)
def test_a_metric_of_a_json_file(text: str, pointer: str, expected: float | None) -> None:
    assert from_json(text, pointer) == expected


def from_log(lines: list[str], metric: Metric) -> float | None:
    return scan([("", line) for line in lines], [metric]).values.get(metric.name)


LINES = ["GOAL 3", "x", "GOAL 1.5", "GOAL nan", "GOAL 2e0 ok"]


@pytest.mark.parametrize(
    ("reduce", "expected"),
    [("first", 3.0), ("last", 2.0), ("count", 4.0), ("sum", 6.5), ("min", 1.5), ("max", 3.0), ("mean", 6.5 / 3)],
)
def test_a_metric_of_a_log(reduce: str, expected: float) -> None:
    assert from_log(LINES, Metric(name="m", service="a", pattern=r"^GOAL (\S+)", reduce=reduce)) == expected


def test_a_log_without_a_match_gives_no_number_but_counts_as_none() -> None:
    assert from_log(["x"], Metric(name="m", service="a", pattern="(y)")) is None
    assert from_log(["x"], Metric(name="m", service="a", pattern="y", reduce="count")) == 0.0


def test_numbers_that_are_too_large_together_are_none() -> None:
    """An error of arithmetic is no reason to end a run."""
    for reduce in ("sum", "mean"):
        for lines in (["GOAL 1e308"] * 3, ["GOAL 1e308", "GOAL 1e308", "GOAL -1e308", "GOAL -1e308"]):
            metric = Metric(name="m", service="a", pattern=r"^GOAL (\S+)", reduce=reduce)
            assert from_log(lines, metric) in (None, 0.0)


@given(st.lists(st.floats(-1e30, 1e30), min_size=1, max_size=40))
def test_a_sum_is_exact_whatever_its_order(numbers: list[float]) -> None:
    metric = Metric(name="m", service="a", pattern=r"^GOAL (\S+)", reduce="sum")
    assert from_log([f"GOAL {one!r}" for one in numbers], metric) == math.fsum(numbers)


PATTERNS = ["^GOAL (\\S+)", "(?i)goal ([0-9]+)", r"x$", r"\Qa(b", "(never)", "ä+"]


@given(st.lists(st.sampled_from(["GOAL 3", "goal 4 x", "ax", "a(b", "", "GOAL nan", "ää", "x goal 7"]), max_size=12))
def test_one_pass_finds_what_a_pass_for_each_finds(lines: list[str]) -> None:
    log = [(str(number), line) for number, line in enumerate(lines)]
    metrics = [
        Metric(name=f"{reduce}{index}", service="a", pattern=pattern, reduce=reduce)
        for index, pattern in enumerate(PATTERNS[:2])
        for reduce in ("first", "last", "min", "max", "mean", "count")
    ]
    found = scan(log, metrics, PATTERNS)
    values: dict[str, float] = {}
    for one in metrics:
        values |= scan(log, [one]).values
    first = {
        pattern: when
        for pattern in PATTERNS
        if (when := next((when for when, line in log if compiled(pattern).search(line)), None)) is not None
    }
    assert found == Scanned(values=values, first=first)


def test_a_long_log_is_read_once_for_all_its_metrics() -> None:
    metrics = [Metric(name=f"m{n}", service="a", pattern=f"^GOAL{n} ([0-9]+)", reduce="sum") for n in range(20)]
    log = (("", "INFO nothing of interest here" if line % 1000 else f"GOAL7 {line}") for line in range(1, 100_001))
    assert bounded(lambda: scan(log, metrics).values) == {"m7": sum(range(1000, 100_001, 1000))}


GIVEN = TrialDefinitions(
    parameters=(Parameter(name="SPEED", values=("0.5", 'a,"b"\nc')),), metrics=(Metric(name="time", service="a"),)
)


def trial() -> Trial:
    return design(GIVEN).trials[0]


def test_times_of_a_row_are_by_the_controllers_clock() -> None:
    """Robot `fast` is 2 s ahead; its container was started 0.3 s after the other, and ended the trial."""
    ahead, right = (Offset(offset_s=offset_s, error_s=0.001, rtt_s=0.002, samples=16) for offset_s in (2.0, 0.0))
    seen = Seen(
        end=End("ok", "a completed", ("a",)),
        readings={
            "a": Reading(state="exited", started=1795338002.3, finished=1795338003.55),
            "b": Reading(state="exited", started=1795338000.0, finished=1795338009.0, restarts=1),
        },
        robots={"a": "fast", "b": "right"},
        before={"fast": ahead, "right": right},
        after={"fast": ahead, "right": Offset(offset_s=0.5, error_s=0.001, rtt_s=0.002, samples=16)},
        ready_s=0.05,
        began=1795338000.31,
        duration_s=1.4,
    )
    found = row(trial(), 1, 4, seen)
    assert found["started_utc"] == "2026-11-22T09:00:00.300+00:00"
    assert found["duration_s"] == pytest.approx(1.25, abs=0.02)
    assert (found["start_skew_ms"], found["start_skew_error_ms"]) == (pytest.approx(300.0, abs=1e-3), 2.0)
    assert (found["clock_max_offset_ms"], found["clock_error_ms"], found["clock_step"]) == (2000.0, 1.0, True)
    assert (found["order"], found["restarts"], found["p_SPEED"]) == (4, 1, "0.5")


def test_a_table_has_one_row_an_attempt_and_nothing_where_nothing_is_known() -> None:
    rows = [row(trial(), 1, 1, Seen(end=End("infrastructure", "robot1: gone"))), {"trial": "x", "m_time": 0.1 + 0.2}]
    text = csv_text(columns(GIVEN), rows)
    found = list(csv.DictReader(io.StringIO(text)))
    assert "\r" not in text
    assert [found[0][name] for name in ("status", "reason", "duration_s", "clock_step")] == [
        "infrastructure", "robot1: gone", "", "",
    ]  # fmt: skip
    assert (found[1]["m_time"], found[1]["p_SPEED"]) == ("0.3", "")
    other = design(GIVEN).trials[1]
    assert (
        next(csv.DictReader(io.StringIO(csv_text(("p_SPEED",), [row(other, 1, 2, Seen(end=End("ok", "")))]))))[
            "p_SPEED"
        ]
        == 'a,"b"\nc'
    )
