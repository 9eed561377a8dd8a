"""What an `env_file` says behind a closing quote: Docker Compose (2.40) takes a name there for the next variable."""

from __future__ import annotations

import pytest

from srprov.definitions import envfile
from srprov.importing.compose import dotenv
from srprov.importing.normal import Refused


@pytest.mark.parametrize(
    ("line", "value"),
    [
        ("X='a' # c", "a"), ('X="a"# c', "a"), ("X='a'#c", "a"), ("X='a'\t# 'c'", "a"), ("X='a' #", "a"),
        ("X='a'  ", "a"), ("X='a'\r", "a"), ("X=' # '", " # "), ("X=''", ""), ("X: 'a'", "a"),
        ("X='a\nb' # c", "a\nb"), ("X=a'b'c", "a'b'c"), ('X=a"b"', 'a"b"'), ("X=it's", "it's"), ('X="it\'s"', "it's"),
        (r"X='it\'s'", "it's"), (r"X='a\\'", r"a\\"), (r"X='a\n'", r"a\n"), (r'X="a\\" # c', "a\\"),
    ],
)  # fmt: skip
def test_what_compose_takes_is_taken_so(line: str, value: str) -> None:
    assert envfile.parse(f"{line}\nY=1\n", "a.env", {}) == ({"X": value, "Y": "1"}, set(), [])


@pytest.mark.parametrize(
    ("text", "place", "behind"),
    [
        (r"X='it'\''s'", (1, 7), r"\''s'"), ('X="a"b', (1, 6), "b"), ("X='a'b", (1, 6), "b"),
        ("X='a' b # c", (1, 7), "b"), ("  X='a' Y=c", (1, 9), "Y=c"), ("X='a'; Y=2", (1, 6), "; Y=2"),
        ('X="a" "b"', (1, 7), '"b"'), ("X='a''b'", (1, 6), "'b'"), ("X='a\nb'c", (2, 3), "c"),
        ("X='a'\\", (1, 6), "\\"),
    ],
)  # fmt: skip
def test_what_stands_behind_a_closing_quote_is_told(text: str, place: tuple[int, int], behind: str) -> None:
    """It was left out, and nobody was told: `'it'\\''s'` was `it`."""
    found, _, problems = envfile.parse(f"{text}\nY=1\n", "a.env", {"b": "of here"})
    assert [(one.location.line, one.location.column) for one in problems] == [place]
    assert problems[0].message == f"'{behind}' stands behind the closing quote"
    assert 'as in "it\'s"' in problems[0].hint
    assert found == {"Y": "1"}


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("X='a'b=c", {"X": "a", "b": "c"}), ('X="a"b', {"X": "a", "b": None}),
        (r"X='it'\''s'", r"no '\', and what stands behind a closing quote is one for Compose"),
        ("X='a' b c", "has a space"), ("X='a'\n'b'", "no '''"),
    ],
)  # fmt: skip
def test_an_import_reads_what_stands_there_as_compose_does(text: str, found: object) -> None:
    """Where Compose refuses it, it is told what that is, and what to write, but not of the next line."""
    read = dotenv.read(text, "a.env", lambda words, _at: words, lambda _name, _at: None)
    if isinstance(found, dict):
        assert {one.name: one.value for one in read} == found
        return
    with pytest.raises(Refused) as refused:
        list(read)
    (problem,) = refused.value.problems
    assert str(found) in problem.message
    assert bool(problem.hint) is ("\n" not in text)
