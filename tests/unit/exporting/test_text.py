"""YAML as it is written: every reader has the same values, and Compose replaces nothing in them."""

from __future__ import annotations

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from srprov.exporting.text import Raw, dump

TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=40)
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**40), 2**40) | TEXTS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(TEXTS, inner, max_size=4),
    max_leaves=20,
)


def undoubled(value: object) -> object:
    """Return values as Compose has them after interpolation; keys are never touched."""
    if isinstance(value, str):
        return value.replace("$$", "$")
    if isinstance(value, list):
        return [undoubled(one) for one in value]
    return {key: undoubled(one) for key, one in value.items()} if isinstance(value, dict) else value


@given(st.dictionaries(TEXTS, VALUES, max_size=5))
def test_what_is_read_is_what_was_written(document: dict[str, object]) -> None:
    assert undoubled(yaml.safe_load(dump(document)) or {}) == document


WORDS = [
    "yes",
    "no",
    "on",
    "~",
    "null",
    "1e3",
    "0x10",
    "010",
    "1:30",
    "2026-11-23",
    ".inf",
    "",
    " a",
    "a: b",
    "a #b",
    "-",
]


@pytest.mark.parametrize("word", [*WORDS, "- a", "!x", "&a", "*a", "%", "@", "`", "{", "[", "1s", "-f", "--x", "---"])
def test_texts_that_look_like_something_else_stay_texts(word: str) -> None:
    assert yaml.safe_load(dump({"a": word, "b": [word], word: "c"})) == {"a": word, "b": [word], word: "c"}


def test_dollars_are_doubled_but_for_those_that_are_meant() -> None:
    text = dump({"$key": "a$b", "home": Raw("${HOME_OF_X:-/home/x}/y"), "lines": "echo $A\necho $B\n"})
    assert "$key: a$$b\n" in text
    assert '"${HOME_OF_X:-/home/x}/y"' in text
    assert "echo $$A\n" in text


def test_scripts_stay_readable_and_short_lists_are_one_line() -> None:
    text = dump(
        {"command": ["sh", "-c", "while :; do\n  echo a\ndone\n"], "cap_add": ["NET_ADMIN", "SYS_NICE"]}, "what\nfor"
    )
    assert text == (
        "# what\n# for\ncommand:\n  - sh\n  - -c\n  - |\n    while :; do\n      echo a\n    done\n"
        "cap_add: [NET_ADMIN, SYS_NICE]\n"
    )


def test_a_comment_cannot_leave_its_line() -> None:
    assert dump({"a": 1}, "one\rtwo\x85three\u2028four").splitlines()[0].startswith("# one")
    assert yaml.safe_load(dump({"a": 1}, "x\r\nservices: {evil: {}}\x0bb: 2")) == {"a": 1}
