"""The tables in the folder of a run of trials, and what describes them: `csv-metadata.json`, as CSV on the Web has it.

Takes what was run and the rows of its attempts, which stand in the journal; writes files. What columns mean is taken
from the schema of what `run --json` prints, where that has them.

Source: W3C, "Metadata Vocabulary for Tabular Data", 2015.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from srprov import data, private
from srprov.definitions.trialsmodel import TrialDefinitions
from srprov.trials.table import (
    CLOCKS,
    CONTAINERS,
    HOSTS,
    METRICS,
    Row,
    columns,
    csv_text,
    metric_rows,
    rows_within,
)

NAME = "csv-metadata.json"
"""Where programs look for it that are given a table in the same folder."""
_KEYS = ("trial", "attempt")
_WITHIN = {"clocks": CLOCKS, "hosts": HOSTS, "containers": CONTAINERS}
"""Key of a row -> the columns of the table that has what stands there."""
_TYPES = {"integer": "integer", "number": "double", "boolean": "boolean", "string": "string"}
_UNITS = {"_s": "s", "_ms": "ms", "_bytes": "byte", "_c": "degree Celsius", "_percent": "percent"}
_METRIC_TEXTS = {
    "metric": "The metric's name.",
    "value": "Its value.",
    "unit": "The unit of the value. Nothing where it has none.",
    "service": "The service that gave it.",
    "robot": "The robot on which the service ran.",
    "source": "The file in the attempt's folder that it was taken from; after # the JSON pointer.",
}


class Tables:
    """All tables of a run, to which attempts are added: a run of thousands makes no row twice."""

    def __init__(self, folder: Path, given: TrialDefinitions, robots: Mapping[str, str], rows: Iterable[Row]) -> None:
        """Take where they are written, what is run, each service's robot, and the attempts that ended earlier."""
        self._folder, self._given, self._robots = folder, given, robots
        self._names = {"trials.csv": columns(given), "metrics.csv": METRICS}
        self._names |= {f"{key}.csv": names for key, names in _WITHIN.items()}
        self._texts = {file: [csv_text(names, ())] for file, names in self._names.items()}
        for row in rows:
            self.add(row)

    def add(self, row: Row) -> None:
        """Add an attempt."""
        metrics = metric_rows([row], self._given.metrics, self._robots)
        within = {f"{key}.csv": rows_within(row, key) for key in _WITHIN}
        found: dict[str, Iterable[Row]] = {"trials.csv": [row], "metrics.csv": metrics, **within}
        for file, rows in found.items():
            self._texts[file].append(csv_text(self._names[file], rows, header=False))

    def write(self) -> None:
        """Write all of them, and what describes them.

        Raises:
            OSError: They cannot be written.
        """
        for file, text in self.texts().items():
            private.replace_file(self._folder / file, text)

    def texts(self) -> dict[str, str]:
        """Return the content of each file."""
        whole = {file: "".join(parts) for file, parts in self._texts.items()}
        return {NAME: json.dumps(description(self._given), indent=2) + "\n", **whole}


def description(given: TrialDefinitions) -> dict[str, Any]:
    """Return what `csv-metadata.json` says: for each table its columns, their types, and what is unique."""
    schema = data.schema("trials-run")["$defs"]
    row, clock, host, container = (schema[name]["properties"] for name in ("row", "clock", "host", "container"))
    metric = {name: {"type": "string", "description": text} for name, text in _METRIC_TEXTS.items()}
    metric["value"]["type"] = "number"
    return {
        "@context": ["http://www.w3.org/ns/csvw", {"@language": "en"}],
        "tables": [
            _table("trials.csv", "Attempts at trials.", columns(given), {**row, **_of_experiment(given)}, _KEYS),
            _table("metrics.csv", "Numbers that attempts gave.", METRICS, {**row, **metric}, (*_KEYS, "metric")),
            _table("clocks.csv", "Robots' clocks.", CLOCKS, {**row, **clock}, (*_KEYS, "robot", "when")),
            _table("hosts.csv", "What robots used.", HOSTS, {**row, **host}, (*_KEYS, "robot")),
            _table("containers.csv", "What containers used.", CONTAINERS, {**row, **container}, (*_KEYS, "service")),
        ],
    }


def _of_experiment(given: TrialDefinitions) -> dict[str, dict[str, Any]]:
    """Return what the columns of parameters and metrics hold, in the words of a JSON Schema."""
    found: dict[str, dict[str, Any]] = {}
    for one in given.parameters:
        text = one.description or f"The value of the parameter {one.name}, as containers get it."
        found[f"p_{one.name}"] = {"type": "string", "description": text, "unit": one.unit}
    for metric in given.metrics:
        text = metric.description or f"The metric {metric.name}, of {metric.service}."
        better = f" The {metric.better}, the better." if metric.better else ""
        found[f"m_{metric.name}"] = {"type": "number", "description": text + better, "unit": metric.unit}
    return found


def _table(
    file: str, text: str, names: Sequence[str], known: Mapping[str, Mapping[str, Any]], keys: Sequence[str]
) -> dict[str, Any]:
    schema: dict[str, Any] = {"columns": [_column(name, known[name], name in keys) for name in names]}
    schema["primaryKey"] = list(keys)
    if file != "trials.csv":
        attempts = {"resource": "trials.csv", "columnReference": list(_KEYS)}
        schema["foreignKeys"] = [{"columnReference": list(_KEYS), "reference": attempts}]
    return {"url": file, "dc:description": text, "tableSchema": schema}


def _column(name: str, about: Mapping[str, Any], key: bool) -> dict[str, Any]:
    unit = about.get("unit") or next((unit for end, unit in _UNITS.items() if name.endswith(end)), "")
    return {
        "name": name,
        "titles": name,
        "dc:description": about["description"],
        "datatype": _datatype(name, about),
        **({"schema:unitText": unit} if unit else {}),
        **({"required": True} if key else {}),
    }


def _datatype(name: str, about: Mapping[str, Any]) -> Any:  # noqa: ANN401 - a name, or a map with limits
    if "enum" in about:
        return {"base": "string", "format": "|".join(about["enum"])}
    if name.endswith("_utc"):
        return "dateTimeStamp"
    kind = about["type"] if isinstance(about["type"], str) else about["type"][0]
    limits = {limit: about[limit] for limit in ("minimum", "maximum") if limit in about}
    return {"base": _TYPES[kind], **limits} if limits else _TYPES[kind]
