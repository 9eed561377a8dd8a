"""A document in one form: what becomes of each spelling, and what is refused."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest
import yaml

from srprov.errors import DefinitionError
from srprov.yamldoc.canonical import canonical
from srprov.yamldoc.nodes import Map, Node, Scalar, Seq

ROOT = Path(__file__).parents[3]


def values(node: Node) -> object:
    """Return what a node says, to be compared; the order of keys counts for nothing."""
    if isinstance(node, Map):
        return node.tag, {key: values(value) for key, value in node.entries.items()}
    if isinstance(node, Seq):
        return node.tag, [values(item) for item in node.items]
    assert isinstance(node, Scalar)
    return node.tag, node.plain, node.text


def comments_in(text: str) -> int:
    """Count the comments of a document: lines with a `#` that is left when all that is read as text is taken out."""
    rows = [list(line) for line in text.replace("\r", "").split("\n")]
    for one in yaml.scan(text, Loader=yaml.CSafeLoader):
        if isinstance(one, yaml.ScalarToken):
            first, last = one.start_mark, one.end_mark
            for number in range(first.line, min(last.line, len(rows) - 1) + 1):
                start = first.column if number == first.line else 0
                end = last.column if number == last.line else len(rows[number])
                if one.style in ("|", ">") and number == first.line:
                    continue  # a comment may stand behind its indicator
                rows[number][start:end] = "x" * (end - start)
    return sum("#" in row for row in rows)


SAME = """\
# head

edf: 1
# about the name
name: x # beside

services:
  # the first
  a:
    image: busybox
    command:
      - sh
      - -c
      - |
        # no comment
        while :; do

          sleep 1
        done
    environment: { A: "1", B: yes }
    volumes:
      - ./x:/x # mounted
      # nothing more

  b: { image: b }
# the end
"""
CASES = {
    SAME: SAME,
    "a:   1\n": "a: 1\n",
    "a:\n- 1\n-   2\n": "a:\n  - 1\n  - 2\n",
    "a:\n    b:\n        c: 1\n": "a:\n  b:\n    c: 1\n",
    "a: 'x'\nb: 'it''s'\nc: 'say \"hi\"'\nd: 'a\\b'\n": "a: \"x\"\nb: \"it's\"\nc: 'say \"hi\"'\nd: 'a\\b'\n",
    "a: {b: 1,c: [ x,y ]}\n": "a: { b: 1, c: [x, y] }\n",
    "a: [\n  1,\n  2\n]\n": "a: [1, 2]\n",
    "a: [1, # one\n  2]\n": "a:\n  - 1 # one\n  - 2\n",
    "a: {} # none\nb: []\n": "a: {} # none\nb: []\n",
    "a: {b: , c: 1}\n": "a:\n  b:\n  c: 1\n",
    f"a: {{b: {'x' * 100}, c: 1234567890}}\n": f"a:\n  b: {'x' * 100}\n  c: 1234567890\n",
    "a: 1\n\n\n\nb: 2\n\n\n": "a: 1\n\nb: 2\n",
    "\n\n# c\na: 1\n": "# c\na: 1\n",
    "# c\r\na: 1\r\n": "# c\na: 1\n",
    "a: |\n     x\n      y\nb: |-\n x\nc: |+\n x\n\n": "a: |\n  x\n   y\nb: |-\n  x\nc: |+\n  x\n\n",
    "a: |2\n   x\n  y\n": "a: |2\n   x\n  y\n",
    "a: >\n   folded\n   text\n\n   more\n": "a: >\n  folded\n  text\n\n  more\n",
    "a: plain\n      and more\n": "a: plain\n  and more\n",
    "a: |   # how\n  x\n": "a: | # how\n  x\n",
    "- a: 1\n  b: 2\n-\n  c: 3\n": "- a: 1\n  b: 2\n- c: 3\n",
    "- - 1\n  - 2\n": "- - 1\n  - 2\n",
    "- # c\n  a: 1\n": "# c\n- a: 1\n",
    "a: # c\n  1\n": "a: 1 # c\n",
    "a:\n  # c\n  1\n": "# c\na: 1\n",
    "a:\n  # c\n  [1]\n": "# c\na: [1]\n",
    "a: [ # none\n]\n": "# none\na: []\n",
    "? a\n: 1\n": "a: 1\n",
    "x: &n {a: 1}\ny: *n\n": "x: &n { a: 1 }\ny: *n\n",
    "a: !replace # c\n  - 1\n": "a: !replace # c\n  - 1\n",
    "--- # c\na: 1\n...\n": "---\n# c\na: 1\n",
    "a:\n- b\n# of what follows\nc: 1\n": "a:\n  - b\n# of what follows\nc: 1\n",
    "a:\n  b: 1\n  # of a\nc: 1\n": "a:\n  b: 1\n  # of a\nc: 1\n",
    "plain\n": "plain\n",
    "[a, b]\n": "[a, b]\n",
    "# nothing\n": "# nothing\n",
}  # fmt: skip


def none(_path: tuple[str, ...]) -> tuple[str, ...]:
    return ()


@pytest.mark.parametrize("text", CASES)
def test_each_spelling_has_one_form(text: str) -> None:
    made = canonical(text, "x", none)
    assert made == CASES[text]
    assert canonical(made, "x", none) == made


def test_keys_stand_in_the_order_that_is_asked_for_with_their_comments() -> None:
    """Those that are not in it come last, as they stood; what stands before all stays there."""
    text = "# file\n\nx-b: 1\nb: 2 # two\n# one\na: 1\nm:\n  b: 1\n  a: 1\n"
    made = canonical(text, "x", lambda path: ("a", "b") if not path else ())
    assert made == "# file\n\n# one\na: 1\nb: 2 # two\nx-b: 1\nm:\n  b: 1\n  a: 1\n"


def test_keys_keep_their_order_where_there_are_anchors() -> None:
    """An alias must not come before what it stands for."""
    text = "b: &n 1\na: *n\n"
    assert canonical(text, "x", lambda _path: ("a", "b")) == text


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("%YAML 1.1\n---\na: 1\n", "it has a directive"),
        ("a: 1\u2028b: 2\n", "U\\+2028 ends a line in YAML, and not in editors"),
        ("a: |\n  x", "cannot be brought into form"),
        ("a: [1\n", "is not valid YAML"),
        ("a: 1\na: 2\n", "duplicate key"),
    ],
)
def test_what_cannot_be_written_anew_is_refused(text: str, words: str) -> None:
    with pytest.raises(DefinitionError) as error:
        canonical(text, "x", none)
    assert re.search(words, error.value.problems[0].message)


def test_the_examples_are_in_their_form_already() -> None:
    from srprov.definitions.formatting import Place, formatted

    files = sorted((ROOT / "examples").rglob("*.[ec]df"))
    assert len(files) > 10
    assert [str(one) for one in files if formatted(Place(str(one), os.path.realpath(one))).changed] == []
