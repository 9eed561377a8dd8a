"""What pages are made of: the files of a record as values, with only those fields that a page shows.

Touches nothing. msgspec holds what it reads to the types below and skips all else, so that a plan of 100 MB costs no
more memory than its steps; a file of another shape is an error that says where.
"""

from __future__ import annotations

from typing import Annotated, Any, TypeAlias

import msgspec

Whole: TypeAlias = Annotated[int, msgspec.Meta(ge=-(2**63), le=2**63 - 1)]
"""A number that a page can show; JSON has whole numbers that are beyond all others."""


class Need(msgspec.Struct, frozen=True):
    """A condition that a step waits for."""

    id: str = ""
    condition: str = ""


class Different(msgspec.Struct, frozen=True, kw_only=True):
    """A value that a step changes."""

    field: str
    old: str | None = None
    new: str | None = None
    note: str = ""
    """Instead of values."""
    diff: tuple[str, ...] = ()
    """Instead of values: lines of a unified diff."""


class PlannedStep(msgspec.Struct, frozen=True, kw_only=True):
    """A step of a plan."""

    number: Whole
    robot: str
    module: str
    name: str
    action: str
    cause: str = ""
    makes: str = ""
    destructive: bool = False
    needs: tuple[Whole, ...] = ()
    waits: tuple[Need, ...] = ()
    differences: tuple[Different, ...] = ()

    @property
    def id(self) -> str:
        """The address of what it is about."""
        return f"{self.robot}/{self.module}:{self.name}"


class AlsoWanted(msgspec.Struct, frozen=True, kw_only=True):
    """What was right already."""

    robot: str = ""
    module: str = ""
    name: str = ""


class Asked(msgspec.Struct, frozen=True, kw_only=True):
    """A permission that a plan asks for."""

    kind: str
    service: str = ""
    what: str = ""


class Playbook(msgspec.Struct, frozen=True, kw_only=True):
    """A playbook beside srprov's own."""

    name: str
    file: str = ""
    place: str = ""


class Moved(msgspec.Struct, frozen=True, kw_only=True):
    """A service that goes to another robot than its data."""

    service: str
    volume: str = ""
    source: str = ""
    target: str = ""
    how: str = ""


class PlanView(msgspec.Struct, frozen=True, kw_only=True):
    """A plan, as `plan -o`, `plan --json` and a record have it."""

    plan: Whole
    instance: str
    source: str = ""
    assignment: dict[str, str] = {}
    cost: float = 0.0
    costs: dict[str, float] = {}
    permissions: tuple[Asked, ...] = ()
    secrets: dict[str, Any] = {}
    playbooks: tuple[Playbook, ...] = ()
    data: tuple[Moved, ...] = ()
    notes: tuple[str, ...] = ()
    unreachable: dict[str, str] = {}
    unchanged: Whole = 0
    counts: dict[str, Whole] = {}
    steps: tuple[PlannedStep, ...] = ()
    also_wanted: tuple[AlsoWanted, ...] = ()
    limit: tuple[str, ...] = ()
    srprov: str = ""
    hash: str = ""
    """What `apply --expect` compares."""


class StepEnd(msgspec.Struct, frozen=True, kw_only=True):
    """What came of a step."""

    number: Whole
    id: str
    outcome: str
    message: str = ""


class RobotEnd(msgspec.Struct, frozen=True, kw_only=True):
    """What a run did on one robot."""

    changed: Whole = 0
    failed: Whole = 0
    connections: Whole = 0
    round_trips: Whole = 0
    bytes_sent: Whole = 0
    bytes_received: Whole = 0
    connect_s: float = 0.0
    asked_s: float = 0.0
    acted_s: float = 0.0
    duration_s: float = 0.0


class ProbeEnd(msgspec.Struct, frozen=True, kw_only=True):
    """What came of trying the overlay."""

    ok: bool
    pairs: Whole = 0
    failed: Whole = 0
    left_out: dict[str, str] = {}
    unreachable: dict[str, str] = {}


class ResultView(msgspec.Struct, frozen=True, kw_only=True):
    """How a run ended: `result.json`."""

    instance: str = ""
    changed: Whole = 0
    unchanged: Whole = 0
    failed: Whole = 0
    skipped: Whole = 0
    not_reached: Whole = 0
    unreachable: tuple[str, ...] = ()
    assignment: dict[str, str] = {}
    cost: float = 0.0
    robots: dict[str, RobotEnd] = {}
    phases: dict[str, float] = {}
    duration_s: float = 0.0
    probe: ProbeEnd | None = None
    steps: tuple[StepEnd, ...] = ()


class EventView(msgspec.Struct, frozen=True, kw_only=True):
    """A line of `events.jsonl`."""

    time: float
    event: str
    robot: str | None = None
    step: Whole | None = None
    outcome: str | None = None
    text: str = ""
    duration_s: float = 0.0


class Terms(msgspec.Struct, frozen=True, kw_only=True):
    """What the cost of a service is made of."""

    cpu: float = 0.0
    memory: float = 0.0
    swap: float = 0.0
    bandwidth: float = 0.0


class DecisionView(msgspec.Struct, frozen=True, kw_only=True):
    """How services were placed, and why."""

    terms: dict[str, Terms] = {}
    optimal: bool | None = None
    least: float = 0.0
    gap: float = 0.0
    jain: float | None = None
    frozen: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    matrix: dict[str, dict[str, float | None]] = {}
    why_not: dict[str, dict[str, str]] = {}


class AssignmentView(msgspec.Struct, frozen=True, kw_only=True):
    """`assignment.json`."""

    assignment: dict[str, str] = {}
    cost: float = 0.0
    costs: dict[str, float] = {}
    decision: DecisionView | None = None


class Endpoint(msgspec.Struct, frozen=True, kw_only=True):
    """Who was asked by a probe."""

    name: str
    kind: str = ""
    robot: str = ""


class PairView(msgspec.Struct, frozen=True, kw_only=True):
    """One asked the other."""

    source: str = msgspec.field(name="from")
    target: str = msgspec.field(name="to")
    failed: tuple[str, ...] = ()
    sent: Whole = 0
    received: Whole = 0
    rtt_ms: tuple[float, float, float] | None = None


class CauseView(msgspec.Struct, frozen=True, kw_only=True):
    """Why some pairs fail."""

    text: str = ""
    hint: str = ""


class ProbeView(msgspec.Struct, frozen=True, kw_only=True):
    """`probe.json`."""

    ok: bool
    mtu: Whole = 0
    duration_s: float = 0.0
    endpoints: tuple[Endpoint, ...] = ()
    pairs: tuple[PairView, ...] = ()
    causes: tuple[CauseView, ...] = ()
    left_out: dict[str, str] = {}
    unreachable: dict[str, str] = {}
