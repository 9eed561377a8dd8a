"""What a person says of trials afterwards: events of a journal -> rows that do not count any more. Pure."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Any

from srprov.trials.judge import COUNTED
from srprov.untrusted import mapping, string

DISCARD, RERUN = "discard", "rerun"
"""Events: a trial counts no more and is not run; it is run again."""
DISCARDED = "discarded"

Row = Mapping[str, Any]


def marked(events: Iterable[Mapping[str, Any]]) -> tuple[list[Row], frozenset[str]]:
    """Return the rows of all attempts that ended, and the trials that are discarded.

    Args:
        events: Of a journal, in order.
    """
    rows: list[Row] = []
    counted: dict[str, list[int]] = {}
    out: dict[str, None] = {}
    for one in events:
        kind, trial = one["event"], string(one.get("trial"))
        if kind == "end":
            rows.append(mapping(one.get("row")))
            if rows[-1].get("status") in COUNTED:
                counted.setdefault(string(rows[-1].get("trial")), []).append(len(rows) - 1)
        elif kind in (DISCARD, RERUN):
            for at in counted.pop(trial, ()):
                rows[at] = _discarded(rows[at], string(one.get("reason")))
            out.pop(trial, None)
            if kind == DISCARD:
                out[trial] = None
    return rows, frozenset(out)


def discarded(rows: Iterable[Row], trials: Collection[str], reason: str) -> list[Row]:
    """Return rows of which those of some trials count no more."""
    return [_discarded(one, reason) if one["trial"] in trials and one["status"] in COUNTED else one for one in rows]


def _discarded(row: Row, reason: str) -> Row:
    return {**row, "status": DISCARDED, "reason": reason}
