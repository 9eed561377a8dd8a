"""Trials as actions of a crate. Pure."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import msgspec

from srprov.evidence import crate_runs
from srprov.evidence.crate_base import Entity, Told, author_ids, file_id, image_id, ref, refs, robot_id, utc
from srprov.evidence.story import attempt_folder
from srprov.trials.judge import COUNTED
from srprov.untrusted import string

_DONE, _FAILED = ("http://schema.org/CompletedActionStatus", "http://schema.org/FailedActionStatus")


class Action(msgspec.Struct, frozen=True):
    """One attempt at a trial, with the values that are only its own."""

    name: str
    entities: tuple[Entity, ...]


def trials(told: Told) -> Iterator[Action]:
    """Return an action for each attempt."""
    story = told.story
    images = [image_id(service) for service in story.images if service in story.services]
    environment = crate_runs.names(crate_runs.environment(told))
    for row in story.rows:
        if "point" in row:
            yield _trial(told, row, images, environment)


def _trial(told: Told, row: Mapping[str, Any], images: Sequence[str], environment: Sequence[str]) -> Action:
    story, folder = told.story, attempt_folder(row)
    name = f"#{folder[7:]}"
    values = {one.name: string(row.get(f"p_{one.name}")) for one in story.given.parameters}
    metrics = {one: row[f"m_{one.name}"] for one in story.given.metrics if row.get(f"m_{one.name}") is not None}
    levels = [_value(f"#{key}-{file_id(value)}", key, value, f"#param-{key}") for key, value in values.items()]
    seed = _value(f"{name}-seed", "seed", str(row.get("seed")), "#param-seed")
    numbers = [
        {**_value(f"{name}-{one.name}", one.name, repr(number), f"#metric-{one.name}"), "unitText": one.unit}
        for one, number in metrics.items()
    ]
    verdict = {"@id": f"{name}-verdict", "@type": "PropertyValue", "name": "verdict",
               "value": string(row.get("verdict")) or "unknown"}  # fmt: skip
    used = crate_runs.usage(name, row)
    counts = row.get("status") in COUNTED
    there = [f"{folder}/"] if f"{folder}/trial.json" in told.files else []
    action: Entity = {
        "@id": name, "@type": "CreateAction", "name": f"Trial {folder[7:]}",
        "description": " ".join(f"{key}={value}" for key, value in values.items()),
        "instrument": ref(file_id(story.edf)), "agent": refs(author_ids(story)[:1]),
        "startTime": utc(row.get("started_utc")), "endTime": _end(row), "actionStatus": _DONE if counts else _FAILED,
        "error": "" if counts else f"{row.get('status')}: {row.get('reason')}",
        "object": refs([*(one["@id"] for one in levels), seed["@id"]]),
        "result": refs([*there, *(one["@id"] for one in numbers), verdict["@id"]]),
        "prov:used": refs(robot_id(robot) for robot in sorted(set(story.services.values()))),
        "containerImage": refs(images), "resourceUsage": refs(crate_runs.names(used)),
        "environment": refs([*environment, *(one["@id"] for one in levels), seed["@id"]]),
    }  # fmt: skip
    return Action(name, (action, *levels, seed, *numbers, verdict, *used))


def _value(name: str, key: str, value: str, of: str) -> Entity:
    return {"@id": name, "@type": "PropertyValue", "name": key, "value": value, "exampleOfWork": ref(of)}


def _end(row: Mapping[str, Any]) -> str:
    """Return when an attempt ended: its start, and how long it took after that."""
    start, seconds = utc(row.get("started_utc")), row.get("duration_s")
    if not start or not isinstance(seconds, int | float):
        return ""
    try:
        end = dt.datetime.fromisoformat(start) + dt.timedelta(seconds=float(seconds))
    except (ValueError, OverflowError):
        return ""
    return end.isoformat(timespec="milliseconds")
