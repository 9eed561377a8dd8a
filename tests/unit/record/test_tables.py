"""The tables of a run's folder, read by programs that know nothing of srprov: they fit their description."""

from __future__ import annotations

import csv
import json
import warnings
from pathlib import Path

import csvw  # type: ignore[import-untyped]  # it has no annotations
import pandas
import pytest
from msgspec.structs import replace

from srprov.controller.trial_report import TrialsReport
from srprov.definitions.trialsmodel import Metric, Parameter, TrialDefinitions
from srprov.record.tables import Tables
from srprov.trials import cgroup, design
from srprov.trials.clock import Offset
from srprov.trials.judge import End
from srprov.trials.row import Seen, clocks, row
from srprov.trials.table import columns

GIVEN = TrialDefinitions(
    parameters=(Parameter(name="SPEED", values=("0.5", 'a,"b"\nc'), unit="m/s", description="Of the racer."),),
    metrics=(
        Metric(name="time", service="racer", file="/out/result.json", pointer="/time", unit="s", better="less"),
        Metric(name="ticks", service="referee", pattern="^tick", reduce="count"),
    ),
)
ROBOTS = {"racer": "r1", "referee": "r2"}
RIGHT = Offset(offset_s=-0.0005, error_s=0.002, rtt_s=0.004, samples=16, measured=1795338000.25)


def written(folder: Path) -> Path:
    """Write the tables of an attempt that is whole, of one that failed early, and of one that a killed run lost."""
    first, second = design(GIVEN).trials
    whole = {
        **row(first, 1, 1, Seen(end=End("ok", 'completed: "racer", and\nmore'), before={"r1": RIGHT, "r2": None})),
        "verdict": "success", "m_time": 1e-7, "m_ticks": 12.0, "collect_s": 0.1, "files": 3, "bytes": 1 << 40,
        "clocks": clocks([{"r1": RIGHT, "r2": None}, {"r2": RIGHT, "r1": RIGHT}]),
        "hosts": [{"robot": "r1", "cpus": 4, "cpu_s": 2.5, "temperature_end_c": -3.5, "throttled": False}],
        "containers": [{"robot": "r1", "service": "racer", **cgroup.row(cgroup.Used(counters={"cpu_s": 1.25}), None)}],
    }  # fmt: skip
    failed = {**row(second, 1, 2, Seen(end=End("infrastructure", "r1: away"))), "clocks": clocks([{"r1": RIGHT}])}
    lost = {"trial": "feedfeedfe-r001", "attempt": 2, "status": "interrupted", "reason": "the run ended before it did"}
    tables = Tables(folder, GIVEN, ROBOTS, [whole])
    for one in (failed, lost):
        tables.add(one)
    tables.write()
    return folder


def read(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


def test_a_csvw_processor_finds_every_table_as_it_is_described(tmp_path: Path) -> None:
    """Types, limits, required cells, unique keys, and attempts that are in trials.csv."""
    folder = written(tmp_path)
    group = csvw.TableGroup.from_file(folder / "csv-metadata.json")
    assert [str(table.url) for table in group.tables] == [
        "trials.csv", "metrics.csv", "clocks.csv", "hosts.csv", "containers.csv",
    ]  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = {str(table.url): list(table.iterdicts(strict=True)) for table in group.tables}
        assert group.check_referential_integrity(strict=True) is not False
        assert all(table.check_primary_key() is not False for table in group.tables)
    assert [len(some) for some in found.values()] == [3, 2, 5, 1, 1]
    assert found["trials.csv"][0]["p_SPEED"] == "0.5" and found["trials.csv"][1]["p_SPEED"] == 'a,"b"\nc'
    assert found["metrics.csv"][0]["value"] == found["trials.csv"][0]["m_time"] == pytest.approx(1e-7, rel=1e-12)
    assert found["clocks.csv"][0]["measured_utc"].microsecond == 250_000


@pytest.mark.parametrize(
    ("table", "old", "new"),
    [
        ("trials.csv", ",ok,", ",fine,"),
        ("trials.csv", ",1099511627776", ",-1"),
        ("metrics.csv", ",12.0,", ",twelve,"),
        ("clocks.csv", "2026-11-22T", "yesterday"),
        ("clocks.csv", ",after,", ",before,"),
        ("clocks.csv", "-r001,1,r2", "-r007,1,r2"),
        ("hosts.csv", ",false", ",cold"),
        ("containers.csv", ",1.25,", ",-1.25,"),
    ],
)
def test_what_does_not_fit_the_description_is_found(tmp_path: Path, table: str, old: str, new: str) -> None:
    """So the test above can fail."""
    path = written(tmp_path) / table
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    group = csvw.TableGroup.from_file(tmp_path / "csv-metadata.json")
    with pytest.raises(ValueError):
        for one in group.tables:
            list(one.iterdicts(strict=True))
            one.check_primary_key()
        group.check_referential_integrity(strict=True)


def test_every_column_is_described_and_no_other(tmp_path: Path) -> None:
    for table in json.loads((written(tmp_path) / "csv-metadata.json").read_text())["tables"]:
        described = table["tableSchema"]["columns"]
        with (tmp_path / table["url"]).open(newline="") as stream:
            assert next(csv.reader(stream)) == [column["titles"] for column in described]
        assert all(column["dc:description"].endswith(".") for column in described)
        units = {column["name"]: column.get("schema:unitText") for column in described}
        if table["url"] == "trials.csv":
            assert (units["p_SPEED"], units["m_time"], units["ready_s"], units["seed"]) == ("m/s", "s", "s", None)


def test_metrics_and_clocks_are_rows_of_their_own(tmp_path: Path) -> None:
    folder = written(tmp_path)
    trial = design(GIVEN).trials[0].id
    assert [list(one.values()) for one in read(folder / "metrics.csv")] == [
        [trial, "1", "time", "1e-07", "s", "racer", "r1", "results/racer/out/result.json#/time"],
        [trial, "1", "ticks", "12.0", "", "referee", "r2", "logs/r2.referee.log"],
    ]
    assert [tuple(one.values())[1:] for one in read(folder / "clocks.csv")][:3] == [
        ("1", "r1", "before", "2026-11-22T09:00:00.250+00:00", "-0.5", "2.0", "4.0", "16", "", "", ""),
        ("1", "r2", "before", "", "", "", "", "0", "", "", ""),
        ("1", "r1", "after", "2026-11-22T09:00:00.250+00:00", "-0.5", "2.0", "4.0", "16", "", "", ""),
    ]


def test_the_line_that_run_ends_with_loads_the_attempts_that_count(tmp_path: Path) -> None:
    folder = tmp_path / "a folder's"
    written(folder)
    report = TrialsReport(folder=folder, rows=(), design=design(GIVEN), ended_early="")
    found = eval(report.loading, {"pandas": pandas})
    assert list(found["status"]) == ["ok"] and list(found["m_time"]) == [1e-7]
    assert set(columns(GIVEN)) == set(found.columns)
    (tmp_path / "digits").mkdir()
    (tmp_path / "digits" / "trials.csv").write_text("point,status\n0123456789,ok\n12e4567890,ok\n")
    same = eval(replace(report, folder=tmp_path / "digits").loading, {"pandas": pandas})
    assert list(same["point"]) == ["0123456789", "12e4567890"]
