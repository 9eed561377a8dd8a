"""Whatever a secret is and however it is encoded, it does not come through; what is none stays as it was."""

from __future__ import annotations

import base64
import json
import urllib.parse
from collections.abc import Callable, Iterator

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from srprov.secret import MASK, SHORTEST, Secret, forget, redact, redact_lines, redacted
from tests.bounded import within
from tests.conftest import examples

# a value with `*` in it could be made anew by the mask and its neighbours, which says nothing of the value
CHARACTERS = st.characters(exclude_categories=["Cs"], exclude_characters="*")
VALUES = st.text(CHARACTERS, min_size=SHORTEST, max_size=40).filter(lambda v: len(v.strip()) >= SHORTEST)
MIB = 1 << 20
AROUND = st.text(CHARACTERS, max_size=20)
ENCODINGS: tuple[Callable[[str], str], ...] = (
    str,
    lambda v: base64.b64encode(v.encode()).decode(),
    lambda v: base64.urlsafe_b64encode(v.encode()).decode().rstrip("="),
    urllib.parse.quote,
    lambda v: urllib.parse.quote(v, safe=""),
    urllib.parse.quote_plus,
    lambda v: json.dumps(v)[1:-1],
    lambda v: json.dumps(v, ensure_ascii=False)[1:-1],
    lambda v: repr(v)[1:-1],
    lambda v: v.encode().hex(),
    lambda v: v.encode().hex(" "),
    lambda v: v.encode().hex(":").upper(),
    lambda v: v.encode().hex(" ", 2),
    lambda v: "".join(f"%{byte:02X}" for byte in v.encode()),
    lambda v: base64.b32encode(v.encode()).decode(),
    lambda v: base64.b32encode(v.encode()).decode().lower().rstrip("="),
)


@pytest.fixture(autouse=True)
def _none_left() -> Iterator[None]:
    """No test sees the secrets of another."""
    yield
    forget()


@settings(max_examples=examples(400), deadline=None)
@given(value=VALUES, before=AROUND, after=AROUND, encode=st.sampled_from(ENCODINGS))
def test_no_form_of_a_value_comes_through(value: str, before: str, after: str, encode: Callable[[str], str]) -> None:
    """Between any two texts, the encoded value is gone and the texts are not."""
    forget()
    Secret(value)
    shown = encode(value)
    result = redact(before + shown + after)
    assert shown not in result and MASK in result


@settings(max_examples=examples(200), deadline=None)
@given(values=st.lists(VALUES, min_size=1, max_size=4), data=st.data())
def test_several_secrets_in_one_text(values: list[str], data: st.DataObject) -> None:
    """Next to each other, overlapping or not, none comes through."""
    forget()
    for value in values:
        Secret(value)
    pieces = data.draw(st.lists(st.sampled_from(values) | AROUND, max_size=8))
    result = redact("".join(pieces))
    assert not [value for value in values if value in result]


@settings(max_examples=examples(200), deadline=None)
@given(value=VALUES, shift=st.binary(max_size=5), after=st.binary(max_size=5))
def test_base64_of_more_than_the_value(value: str, shift: bytes, after: bytes) -> None:
    """Whatever stands before it in the encoded text, no run of the value's own characters is left."""
    forget()
    Secret(value)
    raw = value.encode()
    if len(raw) < 7:
        return  # what is fixed of it is too short to be told from chance
    shown = base64.b64encode(shift + raw + after).decode()
    first = -(-len(shift) * 4 // 3)
    last = (len(shift) + len(raw)) * 4 // 3
    assert shown[first:last] not in redact(shown)


@settings(max_examples=examples(300), deadline=None)
@given(value=VALUES, shift=st.binary(max_size=5), after=st.binary(max_size=5), width=st.integers(1, 80))
def test_what_base64_and_base32_print_of_more_than_the_value(
    value: str, shift: bytes, after: bytes, width: int
) -> None:
    """With wraps of any width, and whatever stands before it, no run of the value's own characters is left."""
    forget()
    Secret(value)
    raw = value.encode()
    if len(raw) < 7:
        return
    for encode, bits in ((base64.b64encode, 6), (base64.b32encode, 5)):
        shown = encode(shift + raw + after).decode()
        own = shown[-(-len(shift) * 8 // bits) : (len(shift) + len(raw)) * 8 // bits]
        wrapped = "\n".join(shown[at : at + width] for at in range(0, len(shown), width))
        assert own not in "".join(redact(wrapped).split())


@settings(max_examples=examples(300), deadline=None)
@given(value=VALUES, encode=st.sampled_from(ENCODINGS), data=st.data())
def test_a_value_that_lines_break_does_not_come_through(
    value: str, encode: Callable[[str], str], data: st.DataObject
) -> None:
    """In one text with indentation, and as a stream that gives line by line."""
    forget()
    Secret(value)
    shown = encode(value).strip()
    if shown != " ".join(shown.split()) or len(shown) < SHORTEST:
        return  # where a blank is next to a break, it may be the text's own
    cuts = sorted(data.draw(st.sets(st.integers(1, len(shown) - 1), max_size=4)))
    parts = [shown[start:stop] for start, stop in zip([0, *cuts], [*cuts, len(shown)], strict=True)]
    if any(part != part.strip() for part in parts):
        return
    indent = data.draw(st.sampled_from(["", "    ", "\t"]))
    assert shown not in "".join(redact(f"before\n{indent}" + f"\n{indent}".join(parts) + "\nafter").split())
    told = list(redact_lines(iter(["before", *parts, "after"])))
    assert shown not in "".join(told) and told[0].startswith("before"[:1]) and told[-1].endswith("after"[-1:])


@given(lines=st.lists(st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\n")), max_size=20))
def test_a_stream_without_secrets_stays_as_it_was(lines: list[str]) -> None:
    """Nothing is lost at a line that only looks like the beginning of a secret."""
    forget()
    Secret("abcdefgh-not-in-any-of-them")
    assert list(redact_lines(iter(lines))) == lines


@pytest.mark.parametrize("text", ["secret-secret-secret", "\n", "s", "secret-secret-secret-secre", "ab ", "%", "a\n  "])
def test_the_time_is_linear_in_the_text(text: str) -> None:
    """Also where the text is made to look like the secret everywhere."""
    forget()
    Secret("secret-" * 2000 + "!")
    with within(5):
        result = redact(text * (MIB // len(text)))
    assert len(result) <= MIB


def shape(value: object) -> object:
    """Return a document with every text left out."""
    if isinstance(value, list):
        return [shape(item) for item in value]
    return "" if isinstance(value, str) else value


@settings(max_examples=examples(200), deadline=None)
@given(value=VALUES, document=st.recursive(st.integers() | st.booleans() | AROUND | VALUES, st.lists))
def test_json_keeps_its_shape(value: str, document: object) -> None:
    """Only texts change, and only those that hold the secret: numbers and lists stay, so it is JSON as before."""
    forget()
    Secret(value)
    result = redacted(document)
    assert shape(result) == shape(document)
    assert redact(json.dumps(document)) != json.dumps(document) or result == document
