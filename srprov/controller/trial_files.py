"""What an attempt of a trial gave: logs, results and metrics, brought into its folder.

Takes the robots and how the attempt ended; writes below the attempt's folder.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from srprov import private, regular_file
from srprov.controller.bringing import CHANGED, Home
from srprov.controller.results import bring_log, bring_results, listed
from srprov.controller.trial_plan import TrialPlan
from srprov.definitions.trialsmodel import Conditions, Metric, Result
from srprov.execution.collect import CollectFailed
from srprov.execution.trial_robots import TrialRobots
from srprov.modules.container_taken import without_taken
from srprov.record.results import Kept, is_safe_name, log_lines
from srprov.secret import redacted
from srprov.session import Session
from srprov.trials.judge import Match
from srprov.trials.metrics import MOST_BYTES as MOST_JSON
from srprov.trials.metrics import from_json, scan
from srprov.trials.reading import engine_time

_T = TypeVar("_T")
_PARTS = ".parts"


class Gathered(msgspec.Struct, frozen=True, kw_only=True):
    """What an attempt gave."""

    metrics: Mapping[str, float] = msgspec.field(default_factory=dict)
    matched: frozenset[Match] = frozenset()
    """Services and patterns of `until` and `success` that some line of their logs matched."""
    first: Mapping[Match, float] = msgspec.field(default_factory=dict)
    """Service and pattern of `until` -> when its log first matched it, by its robot's clock."""
    missing: tuple[str, ...] = ()
    """Required results that are not there."""
    unclosed: int = 0
    """Recordings that their recorders did not close."""
    files: int = 0
    bytes: int = 0


def gather_files(plan: TrialPlan, inspected: Mapping[str, Any], robots: TrialRobots, folder: Path) -> Gathered:
    """Bring logs and results of an attempt into its folder, and take its metrics from them.

    Args:
        plan: What was run.
        inspected: Service -> what its engine says of the container that has ended.
        robots: Where that is.
        folder: The attempt's.

    Raises:
        EquipmentFailed, CollectFailed, TransportError: A robot or its engine failed, or the latter ended a container.
        OSError: Something cannot be written here.
    """
    private.replace_json(folder / "containers.json", redacted(without_taken(inspected)))
    logs = {one.service: folder / "logs" / f"{one.host}.{one.service}.log" for one in plan.services}
    wanted = {one: some for one in robots.by_service if (some := plan.given.results.get(plan.origin[one], ()))}

    def bring(host: str) -> dict[str, dict[Result, list[Kept]]]:
        ours = sorted(name for name, one in robots.by_service.items() if one.host == host)
        for service in ours:
            bring_log(_OfService(robots, service), robots.by_service[service].name, logs[service])
        return {one: _results(robots, inspected.get(one), wanted[one], folder, one) for one in ours if one in wanted}

    found = {one: some for every in robots.each(bring, leave=True).values() for one, some in every.items()}
    shutil.rmtree(folder / _PARTS, ignore_errors=True)
    robots.refuse_doomed()
    kept = {f"{one}{result.path}": some for one in sorted(found) for result, some in found[one].items()}
    missing = [f"{result.path} of {one}" for one in sorted(found) for result in wanted[one]
               if result.required and result not in found[one]]  # fmt: skip
    return _summed(plan, logs, kept, missing, folder)


def _results(
    robots: TrialRobots, inspected: object, wanted: tuple[Result, ...], folder: Path, service: str
) -> dict[Result, list[Kept]]:
    """Fetch a service's results; one that is nowhere is left out.

    Raises:
        CollectFailed: Some file of them is not here: it changes, or cannot be read.
    """
    home = Home(parts=folder / _PARTS / service)
    found = bring_results(_OfService(robots, service), inspected, wanted, folder / "results" / service, home)[0]
    for result, some in found.items():
        if bad := [one for one in some if one.failed]:
            host = robots.by_service[service].host
            doubt = ": does something change it?" if bad[0].note == CHANGED else ""
            raise CollectFailed(f"{host}: {result.path}: {bad[0].path}: {bad[0].note}{doubt}")
    return found


class _OfService:
    """The robot of a service, as transfers know it."""

    def __init__(self, robots: TrialRobots, service: str) -> None:
        self._robots, self._service = robots, service
        self.host = robots.by_service[service].host

    def do(self, work: Callable[[Session], _T]) -> _T:
        """Do something with its session, again if the connection is lost meanwhile."""
        return self._robots.on(self._service, work)


def _summed(
    plan: TrialPlan, logs: Mapping[str, Path], kept: Mapping[str, list[Kept]], missing: list[str], folder: Path
) -> Gathered:
    """Take metrics and matches from what is here, and list it with its hashes."""
    every = [one for some in kept.values() for one in some]
    settings = plan.given.settings
    ends, judges = (_patterns(conditions) for conditions in (settings.until, settings.success))
    metrics = {
        one.name: value for one in plan.given.metrics if one.file and (value := _from_file(one, folder)) is not None
    }
    matched: set[Match] = set()
    first: dict[Match, float] = {}
    for service, path in logs.items():
        wanted = [pattern for name, pattern in (*ends, *judges) if name == service]
        of_log = [one for one in plan.given.metrics if one.pattern and one.service == service]
        found = scan(log_lines(path), of_log, wanted)
        metrics |= found.values
        matched |= {(service, pattern) for pattern in found.first}
        times = {(service, pattern): engine_time(when) for pattern, when in found.first.items()}
        first |= {match: when for match, when in times.items() if match in ends and when}
    listing = {name: [listed(one) for one in some] for name, some in kept.items()}
    document = redacted({"results": listing, "missing": missing})
    private.replace_json(folder / "collected.json", document)
    return Gathered(
        metrics=metrics,
        matched=frozenset(matched),
        first=first,
        missing=tuple(missing),
        unclosed=sum(bool(one.unclosed) for one in every),
        files=sum(bool(one.name) for one in every),
        bytes=sum(one.size for one in every if one.name),
    )


def _patterns(conditions: Conditions | None) -> list[Match]:
    """Return what these conditions look for in which services' logs."""
    items = conditions.items if conditions else ()
    return [(service, one.pattern) for one in items if one.pattern for service in one.services]


def _from_file(metric: Metric, folder: Path) -> float | None:
    if not is_safe_name(metric.file):
        return None
    try:
        text = regular_file.read_text(
            folder / "results" / metric.service / metric.file.strip("/"), MOST_JSON, "replace"
        )
    except OSError:  # it is not there, or too large: there is no number
        return None
    return from_json(text, metric.pointer)
