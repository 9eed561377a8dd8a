"""One trial, from nothing to containers that have ended: made, started, waited for, stopped, and read once more.

Takes a `TrialOrder` and its robots; gives a `TrialEnd`. What its results are is for others to fetch afterwards, and
then to remove.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from typing import Any

import msgspec

from srprov.definitions.trialsmodel import TrialSettings
from srprov.errors import TransportError
from srprov.execution.trial_limits import admit
from srprov.execution.trial_patience import EquipmentFailed
from srprov.execution.trial_robots import TrialRobots
from srprov.linear_regex import compiled
from srprov.trials.clock import Offset
from srprov.trials.judge import End, Match, ended
from srprov.trials.metrics import LONGEST_LINE
from srprov.trials.reading import Reading, read

_LOOK_S = 0.2
"""Between two looks at the containers."""
_SETTLE_LOOK_S = 1.0
_FOUND_DEAD = 255
_AGAIN_S = 1.0
"""Until a log that ended is asked for again."""

Tell = Callable[[str], None]
"""Told each moment of a trial: `created`, `started`, `ready`, `until`, `stopped`."""


class TrialOrder(msgspec.Struct, frozen=True, kw_only=True):
    """What is to be run and waited for."""

    settings: TrialSettings
    jobs: frozenset[str]
    """Services without a `restart`."""
    stop_limit_s: float = 60.0
    told: set[tuple[str, str]] = msgspec.field(default_factory=set)
    """Robots and limits of which was said in this run that they cannot be compared."""


class TrialEnd(msgspec.Struct, frozen=True, kw_only=True):
    """How a trial ended, by what the engines say."""

    end: End
    readings: Mapping[str, Reading] = msgspec.field(default_factory=dict)
    inspected: Mapping[str, Any] = msgspec.field(default_factory=dict)
    """What the engines said, which `readings` were taken from."""
    before: Mapping[str, Offset | None] = msgspec.field(default_factory=dict)
    """Robot -> its clock, measured before."""
    after: Mapping[str, Offset | None] = msgspec.field(default_factory=dict)
    ready_s: float = 0.0
    """From the first start to the moment from which its time counts."""
    began: float = 0.0
    """That moment by our clock, in seconds since the epoch."""
    duration_s: float = 0.0
    """From there to its end, by our clock."""
    stop_s: float = 0.0


def run_trial(order: TrialOrder, robots: TrialRobots, tell: Tell) -> TrialEnd:
    """Run one trial and stop its containers; they are left for who reads their logs and results.

    Args:
        order: What is to be run and waited for.
        robots: Its containers; nothing of them is there.
        tell: Told each moment.

    Raises:
        EquipmentFailed: A robot or its engine failed, or a service did not get ready; containers may be left.
    """
    settings = order.settings
    before = admit(settings.limits, robots, order.told)
    robots.create()
    tell("created")
    begun = time.monotonic()
    watch = _Logs(order, robots)
    _start_all(settings, robots, watch)
    tell("started")
    _get_ready(settings, robots, begun)
    _settle(settings.settle_s, robots)
    ready, began = time.monotonic(), time.time()
    tell("ready")
    end, readings = _wait(order, robots, watch, ready)
    over = time.monotonic()
    tell("until")
    _refuse_restarted(robots, readings)
    watch.over.set()
    _stop(order, robots, readings)
    tell("stopped")
    stopped = time.monotonic()
    inspected = robots.inspect()
    return TrialEnd(
        end=end,
        readings={service: read(answer) for service, answer in inspected.items()},
        inspected=inspected,
        before=before,
        after=robots.clocks(),
        ready_s=ready - begun,
        began=began,
        duration_s=over - ready,
        stop_s=stopped - over,
    )


def _stop(order: TrialOrder, robots: TrialRobots, readings: Mapping[str, Reading]) -> None:
    """Stop what still runs: what shall end first, then the others."""
    first = [name for name in order.settings.stop_first if name in robots.by_service]
    for some in (first, [name for name in robots.by_service if name not in first]):
        if going := [name for name in some if not readings[name].ended]:
            robots.stop(going, order.stop_limit_s)


def _refuse_restarted(robots: TrialRobots, readings: Mapping[str, Reading]) -> None:
    """End the trial when a container died with its robot: an engine says 255 of what it finds dead when it begins."""
    robots.refuse_dead([name for name, one in readings.items() if one.ended and one.exit_code == _FOUND_DEAD])


def _start_all(settings: TrialSettings, robots: TrialRobots, watch: _Logs) -> None:
    """Start all services, each when what it depends on is as it should be."""
    left = set(robots.by_service)
    until = time.monotonic() + settings.ready_s
    readings: Mapping[str, Reading] = {}
    while left:
        due = {name for name in left if all(_is(readings.get(o), how) for o, how in _needs(robots, name).items())}
        if due:
            robots.start(due)
            watch.begin(due)
            left -= due
        if not left:
            return
        readings = robots.look()
        waiting = min(left)
        _refuse_vain(waiting, robots, readings)
        if time.monotonic() > until:
            raise EquipmentFailed(f"{waiting} was not started: what it depends on took over {settings.ready_s:g} s")
        time.sleep(0 if due else _LOOK_S)


def _refuse_vain(waiting: str, robots: TrialRobots, readings: Mapping[str, Reading]) -> None:
    for other, how in _needs(robots, waiting).items():
        reading = readings[other]
        if reading.ended and not _is(reading, how):
            raise EquipmentFailed(f"{waiting} waits for {other}, which exited with {reading.exit_code}")


def _needs(robots: TrialRobots, name: str) -> Mapping[str, str]:
    return robots.by_service[name].needs


def _is(reading: Reading | None, condition: str) -> bool:
    if reading is None:
        return False
    if condition == "completed":
        return reading.ended and reading.exit_code == 0
    return reading.health == "healthy" if condition == "healthy" else reading.started > 0


def _get_ready(settings: TrialSettings, robots: TrialRobots, begun: float) -> None:
    """Wait until every healthcheck says healthy."""
    while late := sorted(name for name, one in robots.look().items() if _is_unwell(one)):
        if time.monotonic() - begun > settings.ready_s:
            raise EquipmentFailed(f"{late[0]} was not healthy within {settings.ready_s:g} s")
        time.sleep(_LOOK_S)


def _settle(seconds: float, robots: TrialRobots) -> None:
    """Wait, and look now and then: an engine that is away meanwhile would be missed."""
    until = time.monotonic() + seconds
    while (left := until - time.monotonic()) > 0:
        time.sleep(min(left, _SETTLE_LOOK_S))
        robots.look()


def _is_unwell(one: Reading) -> bool:
    return one.health not in ("", "healthy") and not one.ended


def _wait(order: TrialOrder, robots: TrialRobots, watch: _Logs, ready: float) -> tuple[End, Mapping[str, Reading]]:
    """Wait for the end; return how it came, and the containers at that moment."""
    while True:
        readings = robots.look()
        elapsed = time.monotonic() - ready
        end = ended(order.settings, order.jobs, readings, watch.matched(), elapsed)
        if end:
            return end, readings
        left = order.settings.timeout_s - elapsed
        watch.news.wait(max(0.0, min(_LOOK_S, left)))
        watch.news.clear()


class _Logs:
    """Follows the logs that `until` looks at."""

    def __init__(self, order: TrialOrder, robots: TrialRobots) -> None:
        items = order.settings.until.items if order.settings.until else ()
        self._robots = robots
        self._patterns: dict[str, list[str]] = {}
        for one in items:
            if one.kind == "log":
                for service in one.services:
                    self._patterns.setdefault(service, []).append(one.pattern)
        self._found: set[Match] = set()
        self.news, self.over = threading.Event(), threading.Event()

    def begin(self, services: set[str]) -> None:
        """Follow those of these services that matter."""
        for service in sorted(services & self._patterns.keys()):
            threading.Thread(target=self._follow, args=(service,), name=f"log {service}", daemon=True).start()

    def matched(self) -> set[Match]:
        """Return what was found so far."""
        return set(self._found)

    def _follow(self, service: str) -> None:
        left = [(pattern, compiled(pattern).search) for pattern in self._patterns[service]]
        while left and not self.over.is_set():
            try:
                for line in self._robots.log(service):
                    text = line.partition(" ")[2][:LONGEST_LINE]
                    for one in [one for one in left if one[1](text)]:
                        left.remove(one)
                        self._found.add((service, one[0]))
                        self.news.set()
                    if not left:
                        return
            except TransportError:
                pass  # whoever looks at the containers has the connection made anew, or ends the trial
            self.over.wait(_AGAIN_S)  # a container that is started again has more to say
