"""The pure parts of the container benchmark."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks import dispersion
from benchmarks.containers import quote, table
from benchmarks.provisioning.quote import replaced

RUNS = {
    "vision": {
        "native": [[1000, 3000], [2000, 4000], [1000, 5000]],
        "container": [[1100, 3100], [2100, 4100], [1100, 5100]],
    }
}


def test_a_row_is_over_all_items_and_the_difference_is_between_the_runs_of_a_block() -> None:
    native, container = table.rows(RUNS)
    assert (native["items"], native["runs"], native["median"], native["longer"]) == (6, 3, 2.5, None)
    assert container["longer"][0] == pytest.approx(100 * 0.1 / (8 / 3))
    assert container["longer"][1] == pytest.approx(0.0, abs=1e-9)


def test_the_papers_rows_are_below_ours_with_the_mean_that_follows_from_them() -> None:
    lines = table.table(table.rows(RUNS)).splitlines()
    assert len({line.count("|") for line in lines}) == 1
    assert "| vision, container | 2.60 ms |" in lines[3]
    assert any(
        line.startswith("| *SLAMBench, the paper, x64* |") and "| 324 ms | 90.8 ms | 0.2800 |" in line for line in lines
    )


@pytest.mark.parametrize(("freedom", "known"), [(5, 2.571), (9, 2.262), (30, 2.042), (198, 1.972)])
def test_intervals_of_few_runs_are_wider(freedom: int, known: float) -> None:
    assert dispersion.quantile(freedom) == pytest.approx(known, rel=0.01)


def test_docs_say_what_the_results_say() -> None:
    docs = quote.DOCS.read_text(encoding="utf-8")
    written = replaced(docs, quote.text(quote.RESULTS), quote.BEGIN, quote.END)
    assert written == docs, "python -m benchmarks.containers.quote writes it anew"


def test_short_or_few_runs_are_called_a_trial_run(tmp_path: Path) -> None:
    about = {"machine": "x86_64", "processor": "p", "cpus": 2, "idle": 0.97, "kernel": "6.18", "docker": "20.10"}
    about |= {"date": "2026-11-22", "versions": {"python": "3.11"}, "repeat": 10}
    for length, called in ((50, True), (881, False)):
        runs = {"vision": {way: [[1000 + number for number in range(length)]] * 10 for way in ("native", "container")}}
        (tmp_path / "containers.json").write_text(json.dumps({**about, "runs": runs}))
        assert ("A trial run" in quote.text(tmp_path)) is called
