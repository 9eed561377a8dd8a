"""All that one page is made of; a part that is None was not there. Values only."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import msgspec

from srprov.report.model import AssignmentView, EventView, PlanView, ProbeView, ResultView, Whole


class Engine(msgspec.Struct, frozen=True, kw_only=True):
    """The Docker of a robot."""

    version: str = ""


class RobotFacts(msgspec.Struct, frozen=True, kw_only=True):
    """A robot as it was before the run."""

    arch: str = ""
    cpus: Whole = 0
    memory_total: Whole = 0
    memory_available: Whole = 0
    os: str = ""
    kernel: str = ""
    board: str = ""
    processor: str = ""
    load1: float = 0.0
    docker: Engine | None = None
    clock_offset_s: float | None = None
    tags: tuple[str, ...] = ()


class FactsView(msgspec.Struct, frozen=True, kw_only=True):
    """`facts.json`."""

    robots: dict[str, RobotFacts] = {}
    unreachable: dict[str, str] = {}


class SourceView(msgspec.Struct, frozen=True, kw_only=True):
    """What a repository has of the experiment."""

    file: str = ""
    commit: str | None = None
    dirty: bool | None = None
    problem: str = ""


class EnvironmentView(msgspec.Struct, frozen=True, kw_only=True):
    """`environment.json`."""

    verb: str = ""
    instance: str = ""
    begun: str = ""
    owner: str = ""
    srprov: str = ""
    python: str = ""
    platform: str = ""
    libraries: dict[str, str] = {}
    source: SourceView | None = None


class InputFile(msgspec.Struct, frozen=True, kw_only=True):
    """A file that a run was made of."""

    name: str
    size: Whole
    sha256: str


class TrialsView(msgspec.Struct, frozen=True, kw_only=True):
    """A run of trials, as its journal has it."""

    document: Mapping[str, Any]
    """What `runs show --json` prints; see `schemas/trials-run.schema.json`."""
    units: Mapping[str, str] = {}
    """Metric -> its unit."""
    images: Mapping[str, tuple[str, str]] = {}
    """Service -> its image's name, and the id that its robot's engine gave to it."""

    @property
    def rows(self) -> Sequence[Mapping[str, Any]]:
        """All attempts, in the order in which they ended."""
        rows: Sequence[Mapping[str, Any]] = self.document["rows"]
        return rows


class Material(msgspec.Struct, frozen=True, kw_only=True):
    """A page's content."""

    kind: str
    """`plan`, `run`, `trials` or `bundle`."""
    name: str
    """Of the record: its folder's or file's name."""
    data_name: str
    """What the data inside the page is called when it is taken out, such as `result.json`."""
    data: bytes
    """The JSON that the page is about, as it is."""
    plan: PlanView | None = None
    result: ResultView | None = None
    events: tuple[EventView, ...] | None = None
    assignment: AssignmentView | None = None
    probe: ProbeView | None = None
    facts: FactsView | None = None
    environment: EnvironmentView | None = None
    trials: TrialsView | None = None
    inputs: tuple[InputFile, ...] = ()
    missing: tuple[str, ...] = ()
    """What could not be read or was not there, in words."""

    @property
    def instance(self) -> str:
        """The instance's id."""
        for one in (self.result, self.plan, self.environment):
            if one is not None and one.instance:
                return one.instance
        return self.name
