"""What a crate says of srprov's own part: its sessions, the libraries it ran with, and what trials used. Pure.

Source: the properties `resourceUsage` and `environment` of Process Run Crate 0.5; units of https://qudt.org.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from srprov.evidence.crate_base import Entity, Told, author_ids, file_id, ref, refs, robot_id, utc
from srprov.trials.marks import Row
from srprov.untrusted import decimal, mappings, string, string_map

_DONE, _FAILED = ("http://schema.org/CompletedActionStatus", "http://schema.org/FailedActionStatus")
_PYPI = "https://pypi.org/project"
_SOLVER = "ortools"
_USAGE = {
    "cpu_s": ("CPU time of all containers", "https://qudt.org/vocab/unit/SEC"),
    "memory_peak_bytes": ("memory of all containers, each at its most", "https://qudt.org/vocab/unit/BYTE"),
    "disk_written_bytes": ("bytes that containers wrote to disks", "https://qudt.org/vocab/unit/BYTE"),
    "net_sent_bytes": ("bytes that containers sent", "https://qudt.org/vocab/unit/BYTE"),
}
"""Column of containers.csv -> what its sum over a trial's containers is, and its unit."""
_MOST = 1e30
"""Of such a number: a stranger's may be anything."""
_MOST_REFERENCES = 200_000
_TAKEN, _MADE = ("inputs/inventory.yml", "facts.json"), ("plan.json", "assignment.json")


def srprov_id(told: Told) -> str:
    """Return the identifier of the srprov that ran it."""
    return f"{_PYPI}/srprov/{string(told.environment.get('srprov'))}/"


def software(told: Told) -> Iterator[Entity]:
    """Return srprov, and the libraries that it ran with; the solver decides who runs what."""
    libraries = string_map(told.environment.get("libraries"))
    ids = {name: f"{_PYPI}/{name}/{version}/" for name, version in sorted(libraries.items())}
    yield {
        "@id": srprov_id(told), "@type": "SoftwareApplication", "name": "srprov",
        "version": string(told.environment.get("srprov")), "url": ref(f"{_PYPI}/srprov/"),
        "description": "The provisioner that ran the trials.", "softwareRequirements": refs(ids.values()),
        "mainEntity": ref(ids[_SOLVER]) if _SOLVER in ids else None,
    }  # fmt: skip
    for name, place in ids.items():
        yield {
            "@id": place, "@type": "SoftwareApplication", "name": name, "version": libraries[name],
            "url": ref(f"{_PYPI}/{name}/"),
        }  # fmt: skip


def sessions(told: Told) -> Iterator[Entity]:
    """Return an action for each time that srprov was run: robots are set up, then trials are run."""
    for number, (session, events) in enumerate(zip(told.story.sessions, _parts(told), strict=False), start=1):
        times = [found for one in events if (found := utc(one.get("utc")))]
        ended = next((one for one in reversed(events) if one.get("event") == "ended"), None)
        reason = "it was cut off" if ended is None else string(ended.get("reason"))
        inputs = [session.edf, *(f"{session.home}/{name}" for name in _TAKEN)]
        made = [*(f"{session.home}/{name}" for name in _MADE), "trials.csv"]
        yield {
            "@id": f"#session-{number}", "@type": "CreateAction", "name": f"Session {number} of the run",
            "description": "srprov set up the robots, then ran trials, of which each is an action of its own.",
            "instrument": ref(srprov_id(told)), "agent": refs(author_ids(told.story)[:1]),
            "startTime": times[0] if times else "", "endTime": times[-1] if times else "",
            "actionStatus": _FAILED if reason else _DONE, "error": reason,
            "object": refs(file_id(name) for name in inputs if name in told.files),
            "result": refs(file_id(name) for name in made if name in told.files),
            "prov:used": refs(robot_id(robot) for robot in sorted(set(session.assignment.values()))),
        }  # fmt: skip


def session_names(told: Told) -> list[str]:
    """Return the identifiers of the sessions' actions."""
    return [string(one["@id"]) for one in sessions(told)]


def _parts(told: Told) -> list[list[Mapping[str, Any]]]:
    """Return the events of each session."""
    found: list[list[Mapping[str, Any]]] = []
    for one in told.story.events:
        if one.get("event") in ("run", "resume"):
            found.append([])
        if found:
            found[-1].append(one)
    return found


def usage(name: str, row: Row) -> list[Entity]:
    """Return what the containers of a trial used together; what nobody measured is left out."""
    found = []
    every = mappings(row.get("containers"))
    for column, (text, unit) in _USAGE.items():
        known = (decimal(one.get(column), low=0.0, high=_MOST, default=math.nan) for one in every)
        if values := [value for value in known if not math.isnan(value)]:
            found.append({
                "@id": f"{name}-used-{column}", "@type": "PropertyValue", "name": text,
                "propertyID": column, "unitCode": unit, "value": f"{sum(values):.15g}",
            })  # fmt: skip
    return found


def environment(told: Told) -> list[Entity]:
    """Return the variables that the definitions set in the containers of trials, as the bundle's files have them.

    Each attempt refers to them, so where that would be very many there are none: the definitions are in the bundle.
    """
    story = told.story
    found = [
        {
            "@id": f"#env-{file_id(service)}-{file_id(name)}", "@type": "PropertyValue", "name": name, "value": value,
            "description": f"Set in the containers of {service}.",
        }
        for service, one in sorted(story.last.choice.experiment.services.items()) if service in story.services
        for name, value in sorted(one.runtime.environment.items()) if value
    ]  # fmt: skip
    return found if len(found) * len(story.rows) <= _MOST_REFERENCES else []


def names(entities: Sequence[Entity]) -> list[str]:
    """Return their identifiers."""
    return [string(one["@id"]) for one in entities]
