"""What the journal of a run of trials says of it: rows of attempts that ended, and attempts that never did."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import msgspec
from msgspec.structs import replace

from srprov.codes import Code
from srprov.errors import UsageError
from srprov.record.journal import read
from srprov.trials.marks import marked
from srprov.trials.reading import engine_time
from srprov.untrusted import integer, mapping, string

_MOST_ATTEMPTS = 1_000_000
ACCEPT = "accept"
"""Event: changes of the experiment were accepted."""


class LostAttempt(msgspec.Struct, frozen=True, kw_only=True):
    """An attempt that was begun and has no end: its controller was gone."""

    trial: str
    attempt: int
    moments: Mapping[str, float] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Event -> when it was, in seconds since the epoch by the controller's clock."""
    segment: int = 1
    row: Mapping[str, Any] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Its row, when all that it gave was at home; else empty."""


class History(msgspec.Struct, frozen=True, kw_only=True):
    """What happened in a run so far."""

    name: str
    """The run's."""
    rows: tuple[Mapping[str, Any], ...] = ()
    begun: Mapping[str, int] = msgspec.field(default_factory=dict)
    """Trial -> attempts that were begun, whether they ended or not."""
    lost: tuple[LostAttempt, ...] = ()
    events: int = 0
    sessions: int = 0
    """How often it was begun or gone on with."""
    same: Mapping[str, str] = msgspec.field(default_factory=dict)
    """What must not have changed -> its value, or a hash of it."""
    segment: int = 1
    """Counted from 1: one more after each time that changes were accepted."""
    discarded: frozenset[str] = frozenset()
    """Trials that count no more, and are not run."""


def read_history(folder: Path) -> History:
    """Return what the journal in a folder says.

    Raises:
        UsageError: It cannot be read, or says nothing.
    """
    events, _ = read(folder)
    if not events or events[0]["event"] != "run":
        raise UsageError(
            f"{folder} holds no run of trials", hint="begin one in another folder, without --resume", code=Code.NO_RUN
        )
    rows, discarded = marked(events)
    if not all(map(_is_row, rows)):
        raise UsageError(
            f"{folder}: the journal has rows that are none",
            hint="somebody changed it; begin a new run",
            code=Code.RECORD,
        )
    begun: dict[str, int] = {}
    lost: dict[tuple[str, int], LostAttempt] = {}
    stated = [events[0]]
    for one in events:
        attempt = str(one.get("trial")), integer(one.get("attempt"), high=_MOST_ATTEMPTS)
        if one["event"] == "begin":
            begun[attempt[0]] = attempt[1]
            lost[attempt] = LostAttempt(trial=attempt[0], attempt=attempt[1], segment=len(stated))
        elif one["event"] == "end":
            lost.pop(attempt, None)
        elif attempt in lost:
            lost[attempt] = _with(lost[attempt], one)
        elif one["event"] == ACCEPT:
            stated.append(one)
    return History(
        name=str(events[0].get("run")),
        rows=tuple(rows),
        begun=begun,
        lost=tuple(lost.values()),
        events=len(events),
        sessions=sum(one["event"] in ("run", "resume") for one in events),
        same={str(key): str(value) for key, value in mapping(stated[-1].get("same")).items()},
        segment=len(stated),
        discarded=discarded,
    )


def _is_row(row: Mapping[str, Any]) -> bool:
    return isinstance(row.get("trial"), str) and isinstance(row.get("status"), str)


def _with(lost: LostAttempt, event: Mapping[str, Any]) -> LostAttempt:
    """Return what is known of an attempt after one more event of it."""
    row = mapping(event.get("row"))
    moments = {**lost.moments, str(event["event"]): engine_time(string(event.get("utc")))}
    ours = _is_row(row) and (row["trial"], row.get("attempt")) == (lost.trial, lost.attempt)
    return replace(lost, moments=moments, row=row if ours else {})
