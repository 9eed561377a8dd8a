"""When a trial has ended, and what came of it."""

from __future__ import annotations

import pytest

from srprov.definitions.trialsmodel import Condition, Conditions, TrialSettings
from srprov.trials.judge import End, ended, verdict
from srprov.trials.reading import Reading

RUNNING, DONE = Reading(state="running", started=1.0), Reading(state="exited", started=1.0, finished=2.0)
FAILED = Reading(state="exited", exit_code=4, started=1.0, finished=2.0)
HEALTHY = Reading(state="running", started=1.0, health="healthy")
KILLED = Reading(state="exited", exit_code=137, oom=True, started=1.0, finished=2.0)


def any_of(*items: Condition) -> Conditions:
    return Conditions(items=items, every=False)


def all_of(*items: Condition) -> Conditions:
    return Conditions(items=items, every=True)


WAITS = ": without `until` it waits for {} to end"
UNREACHED = "all services ended, and 'until' was not reached"
COMPLETED = Condition(kind="completed", services=("a",))
EXIT_0 = Condition(kind="exit", services=("a",))
EXIT_4 = Condition(kind="exit", services=("a",), code=4)
LOG_B = Condition(kind="log", services=("b",), pattern="GOAL")
LOG_EITHER = Condition(kind="log", services=("a", "b"), pattern="GOAL")
AFTER = Condition(kind="after", seconds=5.0)
HEALTHY_B = Condition(kind="healthy", services=("b",))


@pytest.mark.parametrize(
    ("until", "a", "b", "matched", "elapsed", "expected"),
    [
        (None, RUNNING, RUNNING, set(), 1.0, None),
        (None, DONE, RUNNING, set(), 1.0, None),
        (None, DONE, DONE, set(), 1.0, End("ok", "all services ended", ("a", "b"))),
        (None, FAILED, RUNNING, set(), 1.0, End("crashed", "a exited with 4", ("a",))),
        (None, DONE, KILLED, set(), 1.0, End("crashed", "b exited with 137 (out of memory)", ("b",))),
        (None, RUNNING, RUNNING, set(), 10.0, End("timeout", "not over after 10 s" + WAITS.format("a, b"))),
        (None, DONE, RUNNING, set(), 10.0, End("timeout", "not over after 10 s" + WAITS.format("b"))),
        (any_of(COMPLETED), DONE, RUNNING, set(), 1.0, End("ok", "a completed", ("a",))),
        (any_of(COMPLETED), FAILED, RUNNING, set(), 1.0, End("ok", "a completed", ("a",))),
        (any_of(COMPLETED), RUNNING, FAILED, set(), 1.0, End("crashed", "b exited with 4", ("b",))),
        (any_of(COMPLETED), RUNNING, DONE, set(), 1.0, None),
        (any_of(EXIT_4, LOG_B), FAILED, RUNNING, set(), 1.0, End("ok", "a exited with 4", ("a",))),
        (any_of(EXIT_0, LOG_B), FAILED, RUNNING, set(), 1.0, End("crashed", "a exited with 4", ("a",))),
        (any_of(LOG_B), RUNNING, RUNNING, {("b", "GOAL")}, 1.0, End("ok", "b printed GOAL", ("b",))),
        (any_of(LOG_B), RUNNING, RUNNING, {("a", "GOAL")}, 1.0, None),
        (any_of(LOG_EITHER), RUNNING, RUNNING, {("b", "GOAL")}, 1.0, End("ok", "a, b printed GOAL", ("a", "b"))),
        (any_of(AFTER), RUNNING, RUNNING, set(), 5.0, End("ok", "5 s are over")),
        (any_of(AFTER), DONE, DONE, set(), 1.0, None),
        (any_of(HEALTHY_B), RUNNING, HEALTHY, set(), 1.0, End("ok", "b healthy", ("b",))),
        (any_of(LOG_B), DONE, DONE, set(), 1.0, End("crashed", UNREACHED, ("a", "b"))),
        (all_of(COMPLETED, LOG_B), DONE, RUNNING, set(), 1.0, None),
        (all_of(COMPLETED, AFTER), FAILED, RUNNING, set(), 1.0, None),
        (
            *(all_of(COMPLETED, LOG_B), DONE, RUNNING, {("b", "GOAL")}, 1.0),
            End("ok", "a completed and b printed GOAL", ("a", "b")),
        ),
    ],
)  # fmt: skip
def test_how_a_trial_ends(
    until: Conditions | None,
    a: Reading,
    b: Reading,
    matched: set[tuple[str, str]],
    elapsed: float,
    expected: End | None,
) -> None:
    settings = TrialSettings(until=until, timeout_s=10.0)
    assert ended(settings, {"a", "b"}, {"a": a, "b": b}, matched, elapsed) == expected


def test_services_that_never_end_are_no_crash_when_the_jobs_have_ended() -> None:
    """`b` restarts: the trial goes on until its condition holds, or its time is over."""
    settings = TrialSettings(until=any_of(LOG_B), timeout_s=10.0)
    assert ended(settings, {"a"}, {"a": DONE, "b": RUNNING}, set(), 1.0) is None


BELOW = Condition(kind="metric", metric="m", below=2.0)
BETWEEN = Condition(kind="metric", metric="m", below=2.0, above=1.0)
EQUAL = Condition(kind="metric", metric="m", equals=1.0)


@pytest.mark.parametrize(
    ("success", "metrics", "expected"),
    [
        (None, {}, "unknown"),
        (all_of(EXIT_0), {}, "failure"),
        (all_of(EXIT_4), {}, "success"),
        (any_of(EXIT_0, BELOW), {"m": 1.0}, "success"),
        (all_of(EXIT_4, BELOW), {"m": 2.0}, "failure"),
        (all_of(BETWEEN), {"m": 1.5}, "success"),
        (all_of(BETWEEN), {"m": 1.0}, "failure"),
        (all_of(EQUAL), {"m": 1.0}, "success"),
        (all_of(BELOW), {}, "failure"),
    ],
)
def test_the_verdict(success: Conditions | None, metrics: dict[str, float], expected: str) -> None:
    assert verdict(success, {"a": FAILED, "b": RUNNING}, set(), metrics) == expected
