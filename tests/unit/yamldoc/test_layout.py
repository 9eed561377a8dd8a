"""YAML that is written is read as the same values, by srprov's own loader and by PyYAML."""

from __future__ import annotations

from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from srprov.yamldoc import loader, nodes, writer

WORDS = [
    "yes", "no", "on", "null", "~", "", " a", "a ", "1.10", "0644", "1e3", "0x1f", "a: b", "a #b", "- a",
    "#a", "&a", "*a", "!a", "%a", "@a", "`a", "?", ":", "-", "a:", "{a}", "[a]", "a,b", "12:30:45",
    "2024-01-01", "=", "<<", "---", "...", "'a'", "\"a\"", "a\tb", "a\nb", "a\n", "a\n\n", "\na", " a\nb",
    "a \nb", "$x", "${X}", "\u2028", "\u0007", "\U0001f916", "\u00e4", ".5", "+1", "_", "~robot/x",
    "./a:/b", "|", ">", "true", "TRUE", "y", "n", "a\\b", "0b1", "1_000", ".inf", ".nan", "\u0085", "\ufeff",
]  # fmt: skip

TEXTS = st.text(st.characters(blacklist_categories=("Cs",), blacklist_characters="\0"), max_size=20)
VALUES = st.recursive(
    st.one_of(TEXTS, st.booleans(), st.integers(-(10**6), 10**6), st.sampled_from(WORDS)),
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(TEXTS, inner, max_size=4)),
    max_leaves=12,
)


def plain(node: nodes.Node) -> Any:
    """Give what srprov reads as values; scalars by their text."""
    if isinstance(node, nodes.Map):
        return {key: plain(one) for key, one in node.entries.items()}
    if isinstance(node, nodes.Seq):
        return [plain(one) for one in node.items]
    return node.text


def as_text(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: as_text(one) for key, one in value.items()}
    if isinstance(value, list):
        return [as_text(one) for one in value]
    return str(value).lower() if isinstance(value, bool) else str(value)


def check(value: dict[str, Any]) -> None:
    text = writer.document(value)
    assert yaml.safe_load(text) == value, text
    root = loader.parse(text, "x.yml")
    assert root is not None
    assert plain(root) == as_text(value), text


@pytest.mark.parametrize("word", WORDS)
def test_words_stay_text(word: str) -> None:
    check({"a": word, "b": [word, "x"], "c": [{"d": word}], word or "k": "v"})


@given(st.dictionaries(TEXTS, VALUES, min_size=1, max_size=4))
def test_values_come_back(value: dict[str, Any]) -> None:
    if "<<" not in str(value):
        check(value)


def test_it_is_laid_out_as_people_write_it() -> None:
    given = {
        "name": "a",
        "list": ["x", "z"],
        "maps": [{"k": 1, "l": [2]}],
        "script": "one\n  two\n",
        "empty": {},
        "long": ["w" * 60, "v" * 60],
    }
    assert writer.document(given, "made") == (
        "# made\nname: a\nlist: [x, z]\nmaps:\n  - k: 1\n    l: [2]\nscript: |\n  one\n    two\nempty: {}\n"
        f"long:\n  - {'w' * 60}\n  - {'v' * 60}\n"
    )
