"""A run of trials -> Material: its journal, and the record of its last session; of a folder, or of a bundle.

Reads files within limits; they may be anybody's. Where a record has no costs of all robots, as those of an older
srprov, they are worked out again from the experiment and the facts; nothing of either is run.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
from msgspec.structs import replace

from srprov.assignment.report import matrix, why_not
from srprov.codes import Code
from srprov.errors import SrprovError, UsageError
from srprov.evidence import files, story
from srprov.evidence.files import Files, NotThere
from srprov.record.runs import trials_of
from srprov.report.material import EnvironmentView, FactsView, Material, TrialsView
from srprov.report.model import AssignmentView, DecisionView, PlanView
from srprov.report.read import MOST_PLAN, Reading, Unreadable
from srprov.untrusted import mapping, mappings, parse_json, string, string_map

_MOST_CELLS = 2500
"""Pairs of services and robots whose cost is worked out again."""


class _Kept(msgspec.Struct, frozen=True):
    """The files of a run of trials, as pages are read from."""

    files: Files

    def get(self, name: str, most: int) -> bytes | None:
        """Return a file's content, as Source has it."""
        if name not in self.files.sizes:
            return None
        try:
            return files.content(self.files, name, most)
        except (ValueError, OSError) as error:
            raise Unreadable(str(error)) from None

    def names(self, folder: str) -> Iterator[str]:
        """Return the names of files, as Source has it."""
        yield from files.below(self.files, folder)


def of_trials(path: Path) -> Material:
    """Return what the folder of a run of trials holds.

    Raises:
        UsageError: It holds none.
    """
    return _material(files.of_run(path), path.resolve().name, "trials")


def of_bundle(path: Path) -> Material:
    """Return what a bundle holds; its hashes are not looked at.

    Raises:
        UsageError: It is none.
    """
    with files.opened(str(path)) as archive:
        return _material(archive, path.name, "bundle")


def _material(found: Files, name: str, kind: str) -> Material:
    try:
        events = list(story.events_of(found))
        homes = files.sessions(found)
    except NotThere as error:
        raise UsageError(
            f"{name} holds no run of trials: {error}", hint="`srprov verify` looks at a bundle", code=Code.NO_RUN
        ) from None
    document = {**trials_of(events, Path(name)).document, "run": name}
    reading = Reading(_Kept(found), f"{homes[-1]}/" if homes else "")
    if not homes:
        reading.missing.append("it has no record of its sessions: how it was set up is not known")
    view = TrialsView(document=document, units=_units(found), images=_images(events))
    assignment = reading.one("assignment.json", AssignmentView)
    return Material(
        kind=kind,
        name=name,
        data_name="trials.json",
        data=json.dumps(document).encode(),
        plan=reading.one("plan.json", PlanView, most=MOST_PLAN),
        assignment=_explained(found, assignment, reading.missing),
        facts=reading.one("facts.json", FactsView, why="nothing of the robots was recorded"),
        environment=reading.one("environment.json", EnvironmentView),
        trials=view,
        inputs=reading.inputs() if homes else (),
        missing=tuple(reading.missing),
    )


def _units(found: Files) -> dict[str, str]:
    """Return metric -> unit, as the description of the tables has them."""
    try:
        text = files.content(found, "csv-metadata.json", files.MOST_JSON).decode("utf-8", "replace")
        tables = mappings(mapping(parse_json(text)).get("tables"))
    except ValueError:
        return {}
    columns = [one for table in tables for one in mappings(mapping(table.get("tableSchema")).get("columns"))]
    return {
        name.removeprefix("m_"): string(one.get("schema:unitText"))
        for one in columns
        if (name := string(one.get("name"))).startswith("m_")
    }


def _images(events: Sequence[Mapping[str, Any]]) -> dict[str, tuple[str, str]]:
    """Return service -> its image's name and id, as last stated."""
    same = string_map(next((one["same"] for one in reversed(events) if "same" in one), {}))
    names = {key.removesuffix(": image"): value for key, value in same.items() if key.endswith(": image")}
    return {service: (name, same.get(f"{service}: image id", "")) for service, name in sorted(names.items())}


def _explained(found: Files, said: AssignmentView | None, missing: list[str]) -> AssignmentView | None:
    """Return the placement with what each robot would have cost, worked out again where the record does not say it."""
    if said is None or (said.decision and said.decision.matrix):
        return said
    try:
        with story.read(found) as whole:
            problem = whole.last.choice.problem
    except (NotThere, SrprovError) as error:
        missing.append(f"costs of other robots cannot be worked out again: {error}")
        return said
    if len(problem.services) * len(problem.robots) > _MOST_CELLS:
        return said
    costs, reasons = _plain(matrix(problem).items()), _plain(why_not(problem).items())
    return replace(said, decision=replace(said.decision or DecisionView(), matrix=costs, why_not=reasons))


def _plain(rows: Iterable[tuple[str, Mapping[str, Any]]]) -> dict[str, dict[str, Any]]:
    return {name: dict(row) for name, row in rows}
