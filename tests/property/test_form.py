"""`srprov fmt`: whatever a document looks like, its form says the same, has its comments, and is its own form."""

from __future__ import annotations

import functools
import random
from pathlib import Path

from hypothesis import assume, given, settings
from hypothesis import strategies as st

from srprov.errors import DefinitionError
from srprov.yamldoc import loader
from srprov.yamldoc.canonical import canonical
from srprov.yamldoc.written import split
from tests.conftest import examples
from tests.unit.yamldoc.test_canonical import CASES, comments_in, values

ROOT = Path(__file__).parents[2]
FILES = sorted((ROOT / "examples").rglob("*.[ec]df"))
ORDER = ("edf", "cdf", "name", "d", "b", "a")
ODD = (
    "# a comment", "   # deep", "", "a: 1", "- x", "  - y: 2 # beside", "b: {c: 1, d: [x, 'y']}", "c: |", "  text",
    "d: >-", "e: [", "  f, # in", "]", "'k': \"v\"", "- - z", "g: &n 1", "h: *n", "  plain", "-", "i:", "? j", ": k",
    "l: !t # tag", "m: 'it''s'", "n: \"a\\", "  b\"", "\t", "---", "  <<: {z: 1}", "o: ''", "p: |2+", "   q", "- # r",
)  # fmt: skip


def orders(path: tuple[str, ...]) -> tuple[str, ...]:
    return ORDER if len(path) != 1 else ()


def holds(text: str) -> bool:
    """Check all that is promised of a text; False when it cannot be read, or is refused."""
    try:
        before = loader.parse(text, "x")
        made = canonical(text, "x", orders)
    except DefinitionError:
        return False
    if before is None:
        return made == text
    after = loader.parse(made, "x")
    assert after is not None and values(before) == values(after)
    assert comments_in(made) == comments_in(text)
    assert canonical(made, "x", orders) == made, made
    assert not any(line != line.rstrip() for line in split(made) if "#" in line)
    return True


@functools.cache
def lines_of(path: Path) -> list[str]:
    return path.read_text(encoding="utf-8").splitlines()


@given(st.sampled_from(FILES), st.randoms(use_true_random=False))
@settings(max_examples=examples(400))
def test_the_form_of_a_mutated_example_says_the_same(path: Path, chance: random.Random) -> None:
    """Lines are left out, doubled, moved and indented; comments and odd things are put in between."""
    lines = list(lines_of(path))
    for _ in range(chance.randint(1, 5)):
        at = chance.randrange(len(lines))
        kind = chance.randrange(6)
        if kind == 0:
            del lines[at]
        elif kind == 1:
            indent = " " * (len(lines[at]) - len(lines[at].lstrip()))
            lines.insert(at, indent + chance.choice(ODD))
        elif kind == 2:
            lines.insert(at, " " * chance.randrange(6) + "# put in")
        elif kind == 3:
            lines[at] += " # behind"
        elif kind == 4:
            lines.insert(at, "")
        else:
            lines[at] = "  " + lines[at]
        assume(lines)
    holds("\n".join([*lines, ""]))


@given(st.lists(st.tuples(st.integers(0, 3), st.sampled_from(ODD)), min_size=1, max_size=9))
@settings(max_examples=examples(800))
def test_the_form_of_odd_lines_says_the_same(rows: list[tuple[int, str]]) -> None:
    holds("\n".join("  " * indent + row for indent, row in rows) + "\n")


SCALARS = st.sampled_from(
    ["1", "x", "'8080'", '"a: b"', "it's", "~", "yes", "'a\"b'", '"\\t#"', "http://x/#y", "a b", "'#'", "-1", "''"]
)
FLOW = st.recursive(
    SCALARS,
    lambda inner: (
        st.lists(inner, max_size=4).map(lambda some: f"[{', '.join(some)}]")
        | st.lists(inner, max_size=3).map(
            lambda some: "{" + ", ".join(f"k{at}: {v}" for at, v in enumerate(some)) + "}"
        )
    ),
    max_leaves=12,
)


@st.composite
def block(draw: st.DrawFn, indent: int = 0, depth: int = 0) -> list[str]:
    """Return the lines of a map or list in block style, with comments and empty lines."""
    rows: list[str] = []
    is_map = draw(st.booleans())
    for at in range(draw(st.integers(1, 3))):
        margin = " " * indent
        rows += draw(
            st.lists(st.sampled_from(["", f"{margin}# above", f"{margin}#odd  ", f"{margin}  # deep"]), max_size=2)
        )
        head = f"{margin}{'cba'[at]}:" if is_map else f"{margin}-"
        beside = draw(st.sampled_from(["", " # beside", "   #beside"]))
        kind = draw(st.integers(0, 3 if depth < 3 else 2))
        if kind == 0:
            rows.append(f"{head} {draw(FLOW)}{beside}")
        elif kind == 1:
            words = draw(st.lists(st.sampled_from(["text", "", "  more", "# none"]), min_size=1, max_size=4))
            # the first line with words says how deep all are
            words = ["first", *words]
            rows.append(f"{head} {draw(st.sampled_from('|>'))}{draw(st.sampled_from(['', '-', '+']))}{beside}")
            rows += [f"{margin}   {word}".rstrip() for word in words]
        elif kind == 2:
            rows.append(f"{head}{beside}")
        else:
            rows.append(f"{head}{beside}")
            rows += draw(block(indent + draw(st.integers(1, 4)), depth + 1))
    return rows


@given(block())
@settings(max_examples=examples(400))
def test_the_form_of_a_document_with_comments_everywhere_says_the_same(rows: list[str]) -> None:
    assert holds("\n".join([*rows, ""])), rows


def test_odd_documents_are_their_own_form() -> None:
    for text in CASES:
        assert holds(text), text
