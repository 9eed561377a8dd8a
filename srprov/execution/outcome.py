"""What can come of a step and of a run, and the events on the way. Values only."""

from __future__ import annotations

import enum
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import msgspec

from srprov.planning.plan import Step
from srprov.resource import State

if TYPE_CHECKING:
    from srprov.probing.verdict import Probed


class Outcome(enum.Enum):
    """What came of one step."""

    CHANGED = "changed"
    UNCHANGED = "unchanged"
    FAILED = "failed"
    SKIPPED = "skipped"
    UNREACHABLE = "unreachable"
    NOT_REACHED = "not reached"


class StepResult(msgspec.Struct, frozen=True, kw_only=True):
    """One step's end."""

    step: Step
    outcome: Outcome
    message: str = ""
    """Why it failed or was skipped, in words; for a failed command what ran and what it said.

    Of an image that was copied: what was sent.
    """
    duration_s: float = 0.0
    after: State | None = None
    """What was seen when it was verified; None unless it changed something that is there."""


class Event(msgspec.Struct, frozen=True, kw_only=True):
    """Something that a listener may want to show, as it happens."""

    kind: str
    """`start`, `progress`, `waiting` or `end`"""
    host: str
    step: Step | None = None
    text: str = ""
    outcome: Outcome | None = None
    duration_s: float = 0.0


Listener = Callable[[Event], None]


def ended_with(result: StepResult) -> Event:
    """Return the event of a step's end."""
    took, why = result.duration_s, result.message
    return Event(kind="end", host=result.step.host, step=result.step, outcome=result.outcome, text=why, duration_s=took)


class RunResult(msgspec.Struct, frozen=True, kw_only=True):
    """The whole run."""

    results: tuple[StepResult, ...]
    unchanged: int
    """Resources that were right before the run began."""
    interrupted: bool = False
    unreachable: Mapping[str, str] = msgspec.field(default_factory=dict)
    """Robot -> reason, from before or during the run."""
    tolerated: frozenset[str] = frozenset()
    """Robots whose absence the user said is fine."""
    unaudited: Mapping[str, str] = msgspec.field(default_factory=dict)
    """Robot that was changed -> why its audit log has no line of this run."""
    probed: Probed | None = None
    """Whether the overlay works; None: that was not tried."""

    def count(self, outcome: Outcome) -> int:
        """Count steps of one outcome."""
        return sum(result.outcome is outcome for result in self.results)

    @property
    def exit_code(self) -> int:
        """Return the documented code: the first that applies of 130, 3, 4, 0."""
        if self.interrupted:
            return 130
        if self.count(Outcome.FAILED) or (self.probed is not None and not self.probed.works):
            return 3
        if set(self.unreachable) - self.tolerated or self.count(Outcome.UNREACHABLE):
            return 4
        # a step that was skipped although nothing failed waits for a robot that is not there
        return 3 if self.count(Outcome.SKIPPED) or self.count(Outcome.NOT_REACHED) else 0


def past(outcome: Outcome) -> str:
    """Say what became of a step, in words."""
    return {
        Outcome.FAILED: "failed",
        Outcome.SKIPPED: "was skipped",
        Outcome.UNREACHABLE: "could not be reached",
        Outcome.NOT_REACHED: "was not reached",
    }.get(outcome, outcome.value)
