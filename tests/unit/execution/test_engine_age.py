"""Since when an engine runs: by what its robot's /proc shows, whatever that is."""

from __future__ import annotations

import time
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import pytest

from srprov.execution.engine_age import _ASK, engine_began
from srprov.wire import Reply
from tests.bounded import bounded


def said(out: str) -> Any:
    def ask(queries: Sequence[object]) -> list[Reply]:
        assert list(queries) == [_ASK]
        return [Reply(status=0, out=out)]

    return SimpleNamespace(ask=ask)


@pytest.mark.parametrize(
    ("out", "age"),
    [
        ("5000.25 400000\n", 1000.25),
        ("5000.25 400000\n5000.25 490000\n", 100.25),  # the youngest, which may be one in a container
        ("", 0.0),
        ("5000.25 900000\n", 0.0),
        ("5000.25 -7\nnan inf\n1e9 2\n\x00", 0.0),
    ],
)
def test_the_youngest_engine_counts_and_without_one_it_is_now(out: str, age: float) -> None:
    assert engine_began(said(out)) == pytest.approx(time.time() - age, abs=2)


def test_a_long_answer_is_no_work() -> None:
    began = bounded(lambda: engine_began(said("9" * 100 + " 1\n" * 500_000)))
    assert began == pytest.approx(time.time(), abs=5)
