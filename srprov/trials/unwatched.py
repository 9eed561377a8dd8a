"""How an attempt ended that nobody watched, because its controller was gone: by the engines' times alone.

It is data only where a watched one would have given the same: each container was started when the journal says so and
has ended by itself, and what `until` asks for came in time. All times are seconds since the epoch by the controller's
clock. Pure.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

import msgspec
from msgspec.structs import replace

from srprov.definitions.trialsmodel import TrialSettings
from srprov.trials.judge import End, Match, ended
from srprov.trials.reading import Reading

_LAG_S = 1.0
"""Until a controller that watches has seen that a trial is over, and asks its services to end."""


class Told(msgspec.Struct, frozen=True, kw_only=True):
    """When events of an attempt were, by the run's journal."""

    created: float
    started: float
    ready: float
    until: float = 0.0
    """When its end was seen; 0: it was not."""


class NotAdopted(Exception):
    """It cannot be said truthfully how the attempt ended; the text says why."""


def check_ended(settings: TrialSettings, readings: Mapping[str, Reading], told: Told, error_s: float) -> None:
    """Refuse an attempt whose containers have not all ended, or were not started when the journal says so.

    Args:
        settings: Of its trials.
        readings: Service -> its container.
        told: What the journal says.
        error_s: How wrong the readings' times may be.

    Raises:
        NotAdopted: So it is.
    """
    if any(one.kind == "healthy" for one in (settings.until.items if settings.until else ())):
        raise NotAdopted("'until' asks for health, of which an engine keeps no history")
    for name, one in sorted(readings.items()):
        if not one.ended:
            raise NotAdopted(f"{name} {'is gone' if not one.state else 'has not ended'}")
        if not told.created - error_s <= one.started <= told.started + error_s:
            raise NotAdopted(f"{name} was not started when the journal says: it was started again, or a clock was set")


def end_of(
    settings: TrialSettings, jobs: Collection[str], readings: Mapping[str, Reading], first: Mapping[Match, float],
    graces: Mapping[str, float], told: Told, error_s: float,
) -> tuple[End, float]:  # fmt: skip
    """Return how and when an attempt ended whose containers have all ended.

    Args:
        settings: Of its trials.
        jobs: Services that are part of each trial and have no `restart`.
        readings: Service -> its container.
        first: When logs first matched what `until` looks for.
        graces: Service -> seconds that it gets to end.
        told: What the journal says.
        error_s: How wrong times of readings and matches may be.

    Raises:
        NotAdopted: It did not end in time, or a service ran on afterwards.
    """
    end, moment = _first_end(settings, jobs, readings, first, told.ready)
    if moment + error_s > min(told.ready + settings.timeout_s, told.until or float("inf")):
        raise NotAdopted("it was not over in time, or only because it was stopped")
    for name, one in sorted(readings.items()):
        if one.finished > moment + error_s + _LAG_S + graces[name]:
            raise NotAdopted(f"{name} ran on for {one.finished - moment:.1f} s after the trial's end")
    return end, moment


def _first_end(
    settings: TrialSettings, jobs: Collection[str], readings: Mapping[str, Reading], first: Mapping[Match, float],
    ready: float,
) -> tuple[End, float]:  # fmt: skip
    """Go through all moments at which something happened, as a controller that watches would have."""
    waits = [ready + one.seconds for one in (settings.until.items if settings.until else ()) if one.kind == "after"]
    happened = [*(one.finished for one in readings.values()), *first.values(), *waits]
    for moment in sorted({max(ready, one) for one in happened}):
        then = {name: one if one.finished <= moment else _running(one) for name, one in readings.items()}
        matched = {match for match, when in first.items() if when <= moment}
        end = ended(settings, jobs, then, matched, moment - ready)
        if end and end.status != "timeout":
            return end, moment
        if end:
            break
    raise NotAdopted("it did not end as 'until' says within its time")


def _running(one: Reading) -> Reading:
    return replace(one, state="running", exit_code=0, finished=0.0)
