"""Text that is split by rules of others: the same result as theirs, in time that grows with the text alone."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from srprov.definitions import check_files, commandline, envfile, words
from tests.bounded import within

SHORT = st.text(alphabet=" \t\r\n'\"\\#ab$\x0b\u00e9", max_size=16)

COMPOSE: list[tuple[str, list[str] | None]] = [
    ('bash -c "a "$(ls)" b"', ["bash", "-c", "a $(ls) b"]),
    ('echo "a b" $HOME', ["echo", "a b", "$HOME"]),
    ("a; b", ["a"]), ("a & b", ["a"]), ("a 2>x", ["a"]), ("a 12>x", ["a"]), ("a 1b>x", ["a"]), ("a x>y", ["a", "x"]),
    ("> x", []), ("", []), ("   ", []), ("a #b", ["a", "#b"]), ("[1] {x}", ["[1]", "{x}"]),
    ("echo `ls -l` x", ["echo", "`ls -l`", "x"]), ("echo $(ls -l) x", ["echo", "$(ls -l)", "x"]),
    (r"a\nb", ["anb"]), (r'"a\nb\t\d\$"', ["anbtd$"]), (r"'a\nb'", [r"a\nb"]), (r"a\ b", ["a b"]), (r"a'b'\c", ["abc"]),
    ("a ''", ["a", ""]), ("a ''b", ["a", "b"]), ('a ""', ["a", ""]), ('a"b c"d', ["ab cd"]), ('"a" "b"c', ["a", "bc"]),
    ('"$(ls -l)"', ["$(ls -l)"]), ('$(a "b c" d)', ['$(a "b c" d)']), (r'$(a\"b)', ['$(a"b)']),
    ("`a 'b c'`", ["`a b c`"]), ('"a`b c`"', ["a`b c`"]), ("a)b c)", ["a)b c)"]), ("a\u00a0b", ["a\u00a0b"]),
    ("echo (a)", None), ("a )b", None), ("a $(b", None), ("$((1))", None), ("a\\", None), ("it's", None),
]  # fmt: skip


def answer(split: Callable[[str], object]) -> Callable[[str], object]:
    """Return a function that gives ValueError itself where `split` raises it."""

    def called(text: str) -> object:
        try:
            return split(text)
        except ValueError:
            return ValueError

    return called


@given(SHORT)
def test_words_are_those_of_a_shell(text: str) -> None:
    assert answer(words.split)(text) == answer(lambda some: tuple(shlex.split(some)))(text)


@pytest.mark.parametrize(("text", "expected"), COMPOSE)
def test_a_command_is_split_as_compose_does(text: str, expected: list[str] | None) -> None:
    """What Docker Compose 2.40.3 made of these on 2026-11-23; None where it refuses the text.

    So did 6,500 random ones of quotes, blanks, backslashes, parentheses, backquotes and dollars.
    """
    try:
        assert list(commandline.split(text)[0]) == expected
    except ValueError:
        assert expected is None


@pytest.mark.parametrize(
    ("text", "rest"), [("a; b", "; b"), ("a 2>x", ">x"), ("a '; b'", ""), ("a $(b; c)", ""), ("> x", "> x")]
)
def test_what_compose_passes_over_is_told(text: str, rest: str, tmp_path: Path) -> None:
    """In an EDF it is refused: nobody wants half a command."""
    assert commandline.split(text)[1] == rest
    (tmp_path / "e.edf").write_text(f'edf: 1\nname: y\nservices:\n  a: {{image: x, command: "{text}"}}\n')
    problems = [one.message for one in check_files([tmp_path / "e.edf"])]
    assert [f"ends at '{rest[:1]}', as no shell runs it" in one for one in problems] == ([True] if rest else [])


@given(SHORT)
def test_a_comment_hides_the_rest_of_its_line(text: str) -> None:
    split = answer(lambda some: words.split(some, comments=True))
    assert split(text) == answer(lambda some: tuple(shlex.split(some, comments=True)))(text)


@pytest.mark.parametrize("piece", ["a", "'' ", "''", '"a\\b" ', '"'])
def test_a_long_command_is_split_in_time(piece: str) -> None:
    text = piece * (1_000_000 // len(piece))
    with within(3):
        answer(words.split)(text)
    with within(3):
        answer(commandline.split)(text)


def test_commands_as_long_as_they_may_be_are_read_in_time(tmp_path: Path) -> None:
    command = '"' + "a" * 99_000 + '"'
    services = "".join(f"  s{number}: {{image: busybox, command: {command}}}\n" for number in range(20))
    (tmp_path / "e.edf").write_text(f"edf: 1\nname: y\nservices:\n{services}")
    with within(4):
        check_files([tmp_path / "e.edf"])
    assert check_files([tmp_path / "e.edf"]) == []


@pytest.mark.parametrize("begin", ['A="', "A='"])
def test_a_quote_that_is_never_closed_is_told_in_time(begin: str) -> None:
    text = begin + "x\n" * 200_000
    with within(2):
        envfile.parse(text, "a.env", {})
    found, _, problems = envfile.parse(text, "a.env", {})
    assert not found
    assert [(one.location.line, one.message) for one in problems] == [(1, "the quote is not closed")]


def test_values_over_several_lines_end_where_their_quote_does() -> None:
    text = 'A=\'one\ntwo\' # no\n B = "x\\\n\\"y\nz"\nC=1 # no\n'
    assert envfile.parse(text, "a.env", {})[0] == {"A": "one\ntwo", "B": 'x\\\n"y\nz', "C": "1"}
