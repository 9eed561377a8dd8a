"""What an attempt of a trial gave: logs, results and metrics, brought into its folder.

Takes the robots and how the attempt ended; writes below the attempt's folder. A result goes through a file that holds
the robot's tar until its hash was compared; only then it is unpacked.
"""

from __future__ import annotations

import errno
import hashlib
import json
import posixpath
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from srprov import private, regular_file
from srprov.controller.trial_plan import TrialPlan
from srprov.definitions.trialsmodel import Conditions, Metric, Result
from srprov.execution.collect import CollectFailed, Offer, Place, fetch, offers, place_of
from srprov.execution.trial_robots import TrialRobots
from srprov.record.results import Kept, LogTooLong, is_safe_name, log_lines, unpack, write_log
from srprov.secret import redacted
from srprov.session import Session
from srprov.transport.tar_stream import TarError
from srprov.trials.judge import Match
from srprov.trials.metrics import MOST_BYTES as MOST_JSON
from srprov.trials.metrics import from_json, scan
from srprov.trials.reading import engine_time

_MARGIN = 64 << 20
"""Bytes that stay free here, whatever comes."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Gathered:
    """What an attempt gave."""

    metrics: Mapping[str, float] = field(default_factory=dict)
    matched: frozenset[Match] = frozenset()
    """Services and patterns of `until` and `success` that some line of their logs matched."""
    moments: Mapping[str, float] = field(default_factory=dict)
    """Service -> when its log first matched a pattern of `until`, by its robot's clock."""
    missing: tuple[str, ...] = ()
    """Required results that are not there."""
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
    private.replace_file(folder / "containers.json", json.dumps(redacted(inspected), indent=2) + "\n")
    logs = {one.service: folder / "logs" / f"{one.host}.{one.service}.log" for one in plan.services}
    for service, path in logs.items():
        robots.on(service, partial(_bring_log, robots.by_service[service].name, path))
    kept: dict[str, list[Kept]] = {}
    missing: list[str] = []
    for service in sorted(plan.origin):
        wanted = plan.given.results.get(plan.origin[service], ())
        if wanted and service in robots.by_service:
            found = _results(robots, inspected.get(service), wanted, folder, service)
            kept |= {f"{service}{result.path}": some for result, some in found.items()}
            missing += [f"{result.path} of {service}" for result in wanted if result.required and result not in found]
    robots.refuse_doomed()
    return _summed(plan, logs, kept, missing, folder)


def _bring_log(name: str, path: Path, session: Session) -> None:
    try:
        write_log(session.container_log(name, tail=-1, follow=False, times=True), path)
    except LogTooLong as error:
        raise CollectFailed(f"{session.host}: {name}: {error}; print less") from error


def _results(
    robots: TrialRobots, inspected: object, wanted: tuple[Result, ...], folder: Path, service: str
) -> dict[Result, list[Kept]]:
    """Fetch a service's results; one that is nowhere is left out."""
    places = {result: place for result in wanted if (place := place_of(inspected, result.path))}
    every = robots.on(service, lambda session: offers(session, list(places.values())))
    there = dict(zip(places, every, strict=True))
    found: dict[Result, list[Kept]] = {}
    for result, offer in sorted(there.items(), key=lambda one: len(one[0].path)):
        if offer is None:
            continue
        if _inside_one_of(result, [one for one, some in found.items() if any(kept.name for kept in some)]):
            found[result] = []  # it came with the folder that it is in
            continue
        if result.most_bytes and offer.size > result.most_bytes:
            note = f"left on {robots.by_service[service].host}: it has {offer.size} bytes, more than its `max`"
            found[result] = [Kept(path=result.path, size=offer.size, note=note)]
            continue
        # a tar's names begin with the result's own; of a mount's root with what is in it
        whole = places[result].path == "."
        below = folder / "results" / service / (result.path if whole else posixpath.dirname(result.path)).strip("/")
        found[result] = list(_fetched(robots, service, places[result], offer, below, folder))
    return found


def _inside_one_of(result: Result, others: list[Result]) -> bool:
    return any(result.path.startswith(f"{one.path.rstrip('/')}/") for one in others)


def _fetched(robots: TrialRobots, service: str, place: Place, offer: Offer, folder: Path, home: Path) -> Iterator[Kept]:
    """Bring a tar home, compare it with what the robot said, and unpack it."""
    host = robots.by_service[service].host
    private.make_folder(folder)
    if shutil.disk_usage(folder).free < 2 * offer.most + _MARGIN:
        raise CollectFailed(f"{host}: {place.path} has {offer.size} bytes, and there is no room for twice that here")
    whole = home / ".tar.part"
    try:
        with private.open_new(whole) as stream:
            digest = hashlib.sha256()

            def sink(piece: bytes) -> None:
                if stream.tell() + len(piece) > offer.most:
                    raise CollectFailed(f"{host}: {place.path} has more than it said")
                digest.update(piece)
                stream.write(piece)

            robots.on(service, lambda session: fetch(session, place, sink, stream.tell()))
        if digest.hexdigest() != offer.sha256:
            raise CollectFailed(f"{host}: {place.path} is not what it said it has: does something change it?")
        yield from unpack(whole, folder)
    except (TarError, FileExistsError, NotADirectoryError, IsADirectoryError) as error:
        raise CollectFailed(f"{host}: {place.path}: {error}") from error
    except OSError as error:
        if error.errno != errno.ENAMETOOLONG:
            raise
        raise CollectFailed(f"{host}: {place.path} has names that are too long here") from error
    finally:
        whole.unlink(missing_ok=True)


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
    moments: dict[str, float] = {}
    for service, path in logs.items():
        wanted = [pattern for name, pattern in (*ends, *judges) if name == service]
        of_log = [one for one in plan.given.metrics if one.pattern and one.service == service]
        found = scan(log_lines(path), of_log, wanted)
        metrics |= found.values
        matched |= {(service, pattern) for pattern in found.first}
        times = [engine_time(when) for pattern, when in found.first.items() if (service, pattern) in ends]
        if known := [one for one in times if one]:
            moments[service] = min(known)
    listing = {name: [_listed(one) for one in some] for name, some in kept.items()}
    document = redacted({"results": listing, "missing": missing})
    private.replace_file(folder / "collected.json", json.dumps(document, indent=2) + "\n")
    return Gathered(
        metrics=metrics,
        matched=frozenset(matched),
        moments=moments,
        missing=tuple(missing),
        files=sum(bool(one.name) for one in every),
        bytes=sum(one.size for one in every if one.name),
    )


def _listed(one: Kept) -> dict[str, object]:
    about = {"path": one.path, "name": one.name, "size": one.size, "sha256": one.sha256, "note": one.note}
    return {key: value for key, value in about.items() if value not in ("", 0) or key == "path"}


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
