"""What is written is read back as it was, whatever texts hold; comments change nothing."""

from __future__ import annotations

from typing import Any

import yaml
from hypothesis import given
from hypothesis import strategies as st

from srprov.yamldoc.writer import Commented, document

SYNTAX = st.text("ab?:,-#&*![]{}|>'\"%@`=~<^ 01.+xoEe_\t\n/$\\", max_size=12)
TEXTS = (
    SYNTAX
    | st.text(st.characters(exclude_categories=["Cs"]), max_size=30)
    | st.sampled_from(
        [
            "yes",
            "No",
            "null",
            "~",
            "010",
            "1e3",
            "2001-12-14 21:59:43",
            "2001-12-14t21:59:43.10-05:00",
            "0x1f",
            "a: b",
            "# x",
            "- a",
            "\x85",
            "\u2028",
            "\ufeff",
            "\x00",
            "\x7f",
            "🤖",
        ]
    )
)
VALUES = st.recursive(
    TEXTS | st.integers(-(10**12), 10**12) | st.booleans() | st.floats(0.01, 1000),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(TEXTS, inner, max_size=4),
    max_leaves=20,
)


@given(st.dictionaries(TEXTS, VALUES, min_size=1, max_size=5))
def test_what_is_written_is_read_back(values: dict[str, Any]) -> None:
    assert yaml.safe_load(document(values, "one\n\ntwo")) == values


@given(st.dictionaries(TEXTS, VALUES, min_size=1, max_size=5), TEXTS)
def test_comments_change_nothing(values: dict[str, Any], words: str) -> None:
    commented = {key: Commented(value, words) for key, value in values.items()}
    listed = {"list": [Commented(value, words) for value in values.values()], "map": commented}
    assert yaml.safe_load(document(listed)) == {"list": list(values.values()), "map": values}
