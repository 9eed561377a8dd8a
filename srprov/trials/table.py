"""Rows of trials -> tidy tables: one row an attempt, one column a thing, nothing where nothing is known. Pure."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Mapping, Sequence

from srprov.definitions.trialsmodel import Metric, TrialDefinitions
from srprov.trials import cgroup, hosts
from srprov.untrusted import mappings

Row = Mapping[str, object]
CLOCKS = ("trial", "attempt", "robot", "when", "measured_utc", "offset_ms", "error_ms", "rtt_ms", "samples",
          "kept_by", "synchronised", "sync_bound_ms")  # fmt: skip
HOSTS = ("trial", "attempt", "robot", *hosts.COLUMNS)
CONTAINERS = ("trial", "attempt", "robot", "service", *cgroup.COLUMNS, "unread_s")
METRICS = ("trial", "attempt", "metric", "value", "unit", "service", "robot", "source")
_COLUMNS = (
    *("trial", "point", "repetition", "attempt", "segment", "order", "status", "verdict", "reason", "started_utc"),
    *("ready_s", "duration_s", "stop_s", "collect_s", "start_skew_ms", "start_skew_error_ms", "seed"),
)
_LAST = (
    *("clock_max_offset_ms", "clock_error_ms", "clock_step", "restarts", "controller_gap_s", "adopted"),
    *("files", "bytes", "unclosed"),
)


def columns(given: TrialDefinitions) -> tuple[str, ...]:
    """Return the columns of trials.csv."""
    parameters = (f"p_{one.name}" for one in given.parameters)
    return (*_COLUMNS, *parameters, *(f"m_{one.name}" for one in given.metrics), *_LAST)


def rows_within(row: Row, key: str) -> Iterator[Row]:
    """Return an attempt's rows of clocks.csv, hosts.csv or containers.csv, which stand below a key in its own."""
    for one in mappings(row.get(key)):
        yield {"trial": row["trial"], "attempt": row["attempt"], **one}


def metric_rows(rows: Iterable[Row], metrics: Sequence[Metric], robots: Mapping[str, str]) -> Iterator[Row]:
    """Return the rows of metrics.csv: one for each number that an attempt gave; `robots` is of each service."""
    for row in rows:
        for one in metrics:
            if (value := row.get(f"m_{one.name}")) is not None:
                robot = robots.get(one.service, "")
                yield {
                    **{"trial": row["trial"], "attempt": row["attempt"], "metric": one.name, "value": value},
                    **{"unit": one.unit or None, "service": one.service, "robot": robot, "source": _source(one, robot)},
                }


def _source(metric: Metric, robot: str) -> str:
    """Return which file of the attempt's folder a number was taken from."""
    if metric.file:
        return f"results/{metric.service}/{metric.file.strip('/')}#{metric.pointer}"
    return f"logs/{robot}.{metric.service}.log"


def csv_text(names: Sequence[str], rows: Iterable[Row], *, header: bool = True) -> str:
    """Return a table, or without `header` further rows of it, as RFC 4180 has it, but with lines that end in LF."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    if header:
        writer.writerow(names)
    for row in rows:
        writer.writerow([_cell(name, row.get(name)) for name in names])
    return out.getvalue()


def _cell(name: str, value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return repr(float(f"{value:.15g}") if name == "value" or name.startswith("m_") else round(value, 6))
    return str(value)
