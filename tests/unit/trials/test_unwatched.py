"""Attempts that ended while nobody looked: adopted only where a watched one would have given the same."""

from __future__ import annotations

import pytest

from srprov.definitions.trialsmodel import Condition, Conditions, TrialSettings
from srprov.trials.judge import End, Match
from srprov.trials.reading import Reading
from srprov.trials.unwatched import NotAdopted, Told, check_ended, end_of

TOLD = Told(created=99.0, started=100.5, ready=101.0)
JOBS = ("racer", "timer")
GOAL = ("racer", "GOAL")
ERROR_S = 0.01


def ended_at(finished: float, code: int = 0, started: float = 100.0) -> Reading:
    return Reading(state="exited", exit_code=code, started=started, finished=finished)


def until(*items: Condition, every: bool = False, timeout_s: float = 10.0) -> TrialSettings:
    return TrialSettings(timeout_s=timeout_s, until=Conditions(items=items, every=every) if items else None)


def completed(*services: str) -> Condition:
    return Condition(kind="completed", services=services)


def end(
    settings: TrialSettings, racer: Reading, timer: Reading, told: Told = TOLD, first: dict[Match, float] | None = None
) -> tuple[str, float]:
    readings = {"racer": racer, "timer": timer}
    check_ended(settings, readings, told, ERROR_S)
    found, moment = end_of(settings, JOBS, readings, first or {}, dict.fromkeys(JOBS, 2.0), told, ERROR_S)
    assert isinstance(found, End)
    return found.status, moment


LOG, AFTER = Condition(kind="log", services=("racer",), pattern="GOAL"), Condition(kind="after", seconds=3.0)
EXIT_4 = Condition(kind="exit", services=("racer",), code=4)


@pytest.mark.parametrize(
    ("settings", "racer", "timer", "first", "expected"),
    [
        (until(), ended_at(105), ended_at(104), {}, ("ok", 105)),
        (until(), ended_at(100.2), ended_at(100.3), {}, ("ok", 101)),  # over at once
        (until(completed("racer")), ended_at(105), ended_at(107.9), {}, ("ok", 105)),  # the other within its grace
        (until(completed("racer")), ended_at(105), ended_at(104, 3), {}, ("crashed", 104)),
        (until(completed("racer"), completed("timer"), every=True), ended_at(105), ended_at(106), {}, ("ok", 106)),
        (until(EXIT_4), ended_at(105, 4), ended_at(104), {}, ("ok", 105)),
        (until(EXIT_4), ended_at(105, 5), ended_at(104), {}, ("crashed", 105)),
        (until(EXIT_4), ended_at(105), ended_at(104), {}, ("crashed", 105)),  # all ended, and it was not reached
        (until(LOG), ended_at(105), ended_at(104), {GOAL: 103.5}, ("ok", 103.5)),
        (until(AFTER), ended_at(105), ended_at(104.5), {}, ("ok", 104)),
    ],
)
def test_the_end_is_that_which_a_controller_would_have_seen(
    settings: TrialSettings, racer: Reading, timer: Reading, first: dict[Match, float], expected: tuple[str, float]
) -> None:
    assert end(settings, racer, timer, first=first) == expected


@pytest.mark.parametrize(
    ("settings", "racer", "timer", "why"),
    [
        (until(), Reading(state="running", started=100.0), ended_at(104), "racer has not ended"),
        (until(), Reading(state=""), ended_at(104), "racer is gone"),
        (until(), ended_at(105, started=100.6), ended_at(104), "racer was not started when the journal says"),
        (until(), ended_at(105, started=98.9), ended_at(104), "racer was not started when the journal says"),
        (until(completed("racer")), ended_at(105), ended_at(108.2), r"timer ran on for 3\.2 s"),
        (until(), ended_at(112), ended_at(104), "not over in time"),
        (until(), ended_at(110.995), ended_at(104), "not over in time"),  # within it, but for the clocks' error
        (until(AFTER, timeout_s=2.0), ended_at(103.5), ended_at(103.5), "within its time"),
        (until(Condition(kind="healthy", services=("racer",))), ended_at(105), ended_at(104), "health"),
    ],
)
def test_what_cannot_be_said_truthfully_is_not_adopted(
    settings: TrialSettings, racer: Reading, timer: Reading, why: str
) -> None:
    with pytest.raises(NotAdopted, match=why):
        end(settings, racer, timer)


def test_what_the_earlier_controller_stopped_did_not_end_by_itself() -> None:
    """Its journal has the moment at which it saw the end, which was that the time was over."""
    stopped = Told(created=99.0, started=100.5, ready=101.0, until=104.0)
    with pytest.raises(NotAdopted, match="only because it was stopped"):
        end(until(), ended_at(104.1), ended_at(104.1), stopped)
    assert end(until(), ended_at(103.8), ended_at(103.9), stopped) == ("ok", 103.9)
