"""Rows of trials -> tidy tables: one row an attempt, one column a thing, nothing where nothing is known. Pure."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence

from srprov.definitions.trialsmodel import TrialDefinitions

Row = Mapping[str, object]
_COLUMNS = (
    *("trial", "point", "repetition", "attempt", "order", "status", "verdict", "reason", "started_utc", "ready_s"),
    *("duration_s", "stop_s", "collect_s", "start_skew_ms", "start_skew_error_ms", "seed"),
)
_LAST = ("clock_max_offset_ms", "clock_error_ms", "clock_step", "restarts", "controller_gap_s", "files", "bytes")


def columns(given: TrialDefinitions) -> tuple[str, ...]:
    """Return the columns of trials.csv."""
    parameters = (f"p_{one.name}" for one in given.parameters)
    return (*_COLUMNS, *parameters, *(f"m_{one.name}" for one in given.metrics), *_LAST)


def csv_text(names: Sequence[str], rows: Iterable[Row]) -> str:
    """Return a table as RFC 4180 has it, but with lines that end in LF."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(names)
    for row in rows:
        writer.writerow([_cell(row.get(name)) for name in names])
    return out.getvalue()


def _cell(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return repr(round(value, 6))
    return str(value)
