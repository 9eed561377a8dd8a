"""The benchmark of trials: steps follow from moments, and docs say what the results say."""

from __future__ import annotations

import pytest

from benchmarks.provisioning.quote import replaced
from benchmarks.provisioning.robots import Trouble
from benchmarks.trials import quote
from benchmarks.trials.steps import overheads, summary, table
from benchmarks.trials.ways import trials_of


def test_a_trial_costs_what_it_takes_until_the_next_one_less_its_service() -> None:
    first = {"begin": 10.0, "create": 10.1, "start": 10.5, "wait": 11.6, "remove": 11.8}
    second = {"begin": 12.0, "create": 12.3, "start": 12.6, "wait": 13.5, "remove": 13.6}
    found = overheads([first, second], 1.0)
    assert found[0] == pytest.approx(
        {"create": 0.1, "start": 0.4, "wait": 0.1, "remove": 0.2, "between": 0.2, "all": 1.0}
    )
    assert found[1] == pytest.approx({"create": 0.3, "start": 0.3, "wait": -0.1, "remove": 0.1, "all": 0.6})
    assert summary(found)["all"] == pytest.approx({"median": 0.8, "p95": 1.0})


def test_p95_is_the_least_value_that_95_percent_are_not_above() -> None:
    found = summary([{"all": float(number)} for number in range(1, 201)])
    assert found["all"] == {"median": 100.5, "p95": 190.0}


def test_moments_are_read_from_a_journal_whatever_else_it_has() -> None:
    names = ["begin", "created", "started", "ready", "until", "stopped", "news", "collected"]
    events = [{"event": name, "monotonic": float(at)} for at, name in enumerate(names)]
    end = {"event": "end", "monotonic": 9.0, "row": {"status": "ok", "reason": ""}}
    (trial,) = trials_of([{"event": "run", "monotonic": 0.0}, *events, end])
    assert trial == {"begin": 0, "create": 1, "start": 2, "wait": 4, "stop": 5, "collect": 7, "remove": 9}
    with pytest.raises(Trouble, match="crashed"):
        trials_of([*events, {**end, "row": {"status": "crashed", "reason": "exit 1"}}])


def test_the_table_has_a_dash_where_a_way_has_no_such_step() -> None:
    rows = [
        {"tool": "a", "trials": 2, "steps": {"all": {"median": 1.2, "p95": 1.5}, "stop": {"median": 0.1, "p95": 0.2}}},
        {"tool": "b", "trials": 3, "steps": {"all": {"median": 0.9, "p95": 1.0}}},
    ]
    assert table(rows).splitlines()[2:] == ["| a | 1200 (1500) | 100 (200) | 2 |", "| b | 900 (1000) | - | 3 |"]


def test_docs_say_what_the_results_say() -> None:
    docs = quote.DOCS.read_text(encoding="utf-8")
    written = replaced(docs, quote.text(quote.RESULTS), quote.BEGIN, quote.END)
    assert written == docs, "python -m benchmarks.trials.quote writes it anew"
