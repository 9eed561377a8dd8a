"""Ratios of pairs: the median, an interval that holds it, and no pair of which one run failed."""

from __future__ import annotations

import pytest

from benchmarks.provisioning.versions import line, ratios


def _rows(old: list[float], new: list[float], problem: int | None = None) -> list[dict[str, object]]:
    rows: list[dict[str, object]] = []
    for pair, both in enumerate(zip(old, new, strict=True)):
        for tool, seconds in zip(("old", "new"), both, strict=True):
            failed = "no ping" if pair == problem and tool == "new" else ""
            rows.append({"latency_ms": 40, "scenario": "nothing", "tool": tool, "seconds": seconds, "pair": pair})
            rows[-1]["problem"] = failed
    return rows


def test_the_ratio_is_that_of_pairs_and_not_of_medians() -> None:
    one = ratios(_rows([1, 2, 4], [1.1, 2.4, 4.0]))[0]
    assert one["ratio"] == pytest.approx(1.1)
    assert (one["low"], one["high"]) == (pytest.approx(1.0), pytest.approx(1.2))
    assert line(one) == " 40 ms  nothing  old 2.00 s, new 2.40 s: 1.100 [1.000, 1.200], 3 pairs"


def test_a_pair_with_a_failed_run_is_left_out() -> None:
    one = ratios(_rows([1, 1, 1], [1, 9, 1], problem=1))[0]
    assert (one["pairs"], one["ratio"]) == (2, pytest.approx(1.0))


def test_nothing_but_failures_gives_no_row() -> None:
    assert ratios(_rows([1], [1], problem=0)) == []
