"""Attempts whose controller was gone when they ended: what they gave is brought home, and they are judged.

Takes what the journal says of one, and the robots; gives its row. Its containers must be there as it left them, and
their engines must have run all the while: see `trials.unwatched` for what else must hold.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

from msgspec.structs import replace

from srprov import private
from srprov.controller.trial_files import gather_files
from srprov.controller.trial_history import LostAttempt
from srprov.controller.trial_outcome import Attempt, Row, outcome
from srprov.controller.trial_plan import TRIAL, TrialPlan
from srprov.errors import TransportError
from srprov.execution.collect import CollectFailed
from srprov.execution.engine_age import engine_began
from srprov.execution.trial import TrialEnd
from srprov.execution.trial_patience import EquipmentFailed
from srprov.trials.clock import Offset
from srprov.trials.judge import End
from srprov.trials.reading import Reading, read
from srprov.trials.row import clocks
from srprov.trials.unwatched import NotAdopted, Told, check_ended, end_of
from srprov.untrusted import mapping


def adopted(one: Attempt, lost: LostAttempt) -> Row:
    """Bring home what an attempt gave that ended while nobody looked, and return its row.

    What an earlier session brought into its folder is brought anew.

    Args:
        one: The attempt; its robots are locked.
        lost: What the journal says of it.

    Raises:
        NotAdopted: It cannot be said truthfully how it ended, or it did not end; the text says why.
        OSError: Something cannot be written here.
    """
    told, plan, robots = _told(lost), one.plan, one.robots
    try:
        inspected = robots.inspect()
        _check_ours(inspected, f"{one.trial.id}.{one.number}")
        offsets = robots.clocks()
        times = _Here(plan, offsets)
        readings = times.readings(inspected)
        check_ended(plan.given.settings, readings, told, times.error_s)
        _check_engines(one, readings)
        begun = time.monotonic()
        private.make_folder(one.folder)  # what came home before is not fetched again
        gathered = gather_files(plan, inspected, robots, one.folder)
        collect_s = time.monotonic() - begun
    except (EquipmentFailed, CollectFailed, TransportError) as error:
        raise NotAdopted(error.message if isinstance(error, TransportError) else str(error)) from error
    first = {match: times.here(match[0], when) for match, when in gathered.first.items()}
    graces = {name: container.grace_s for name, container in robots.by_service.items()}
    end, moment = end_of(plan.given.settings, plan.jobs, readings, first, graces, told, times.error_s)
    ended = _trial_end(end, moment, told, inspected, offsets)
    more = {"stop_s": None, "collect_s": collect_s, "clocks": clocks([dict.fromkeys(offsets), offsets])}
    return {**outcome(one, ended, gathered), **more, "adopted": True}


def _told(lost: LostAttempt) -> Told:
    moments = lost.moments
    if not all(moments.get(event) for event in ("created", "started", "ready")):
        raise NotAdopted("its time had not begun")
    return Told(
        created=moments["created"],
        started=moments["started"],
        ready=moments["ready"],
        until=moments.get("until", 0.0),
    )


def _check_ours(inspected: Mapping[str, Any], label: str) -> None:
    for service, answer in sorted(inspected.items()):
        if answer and mapping(mapping(mapping(answer).get("Config")).get("Labels")).get(TRIAL) != label:
            raise NotAdopted(f"the container of {service} is of another attempt")


class _Here:
    """Robots' times by the controller's clock."""

    def __init__(self, plan: TrialPlan, offsets: Mapping[str, Offset | None]) -> None:
        robots = plan.robots
        known = {host: one for host, one in offsets.items() if one}
        if missing := sorted(offsets.keys() - known.keys()):
            raise NotAdopted(f"the clock of {missing[0]} is not known")
        self._offsets = {service: known[host].offset_s for service, host in robots.items()}
        self.error_s = max(one.error_s for one in known.values())

    def here(self, service: str, moment: float) -> float:
        return moment - self._offsets[service]

    def readings(self, inspected: Mapping[str, Any]) -> dict[str, Reading]:
        found = {service: read(answer) for service, answer in inspected.items()}
        return {
            service: replace(
                one,
                started=self.here(service, one.started) if one.started else 0.0,
                finished=self.here(service, one.finished) if one.finished else 0.0,
            )
            for service, one in found.items()
        }


def _check_engines(one: Attempt, readings: Mapping[str, Reading]) -> None:
    """Refuse containers that may have ended because their engine did."""
    for container in one.robots.by_service.values():
        if one.robots.on(container.service, engine_began) > readings[container.service].started:
            raise NotAdopted(f"the Docker Engine of {container.host} began after {container.service}, or is not seen")


def _trial_end(
    end: End, moment: float, told: Told, inspected: Mapping[str, Any], offsets: Mapping[str, Offset | None]
) -> TrialEnd:
    """Return what a controller that had looked would have seen; its clocks are those of now."""
    return TrialEnd(
        end=end,
        readings={service: read(answer) for service, answer in inspected.items()},
        inspected=inspected,
        before=offsets,
        ready_s=told.ready - told.created,
        began=told.ready,
        duration_s=moment - told.ready,
    )
